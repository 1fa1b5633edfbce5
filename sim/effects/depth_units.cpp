// depth_units: depth comes in whole steps of a length.
//
// Phenomenon: the device, its driver or the file stores depth as an integer number of steps.
// Model: z' = step * round(z / step), ties to even.
//   | step | mm | 0 = absent; 1 mm for most drivers' uint16 depth, 0.1 mm for finer ones |
// The comb stands at the same depths at every distance, unlike disparity_quantisation's, whose steps grow with z^2.
// Source: any depth driver's unit, e.g. rs2::depth_sensor::get_depth_scale of librealsense; no deviation.
// Not for: the rounding to the recording's own depth_scale, which the sensor does at its very end in any case.
#include "sim/effect.h"

namespace binrig::effects {

namespace {

EffectDeclaration declare() {
  EffectDeclaration d;
  d.name = "depth_units";
  d.phenomenon = "Depth comes in whole steps of a length.";
  d.stage = Stage::storage;
  d.formula = "z' = step * round(z / step)";
  d.citation = "the depth unit of device drivers, e.g. librealsense's get_depth_scale";
  d.parameters = {{.name = "step",
                   .unit = "mm",
                   .lower = 0,
                   .upper = 1000,
                   .typical_low = 0.02,
                   .typical_high = 10,
                   .neutral = 0.0,
                   .initial = 0.5,
                   .log_scaled = true,
                   .interpolate = false,
                   .meaning = "the step; 0 = none"}};
  d.amplitude = "step";
  d.revealed_by = "a slightly tilted plane, any distance";
  return d;
}

}  // namespace

const Effect& depth_units() {
  static const Effect effect{declare(), [](const EffectInstance& instance, const CaptureContext&) {
                               const double step = instance.value("step");
                               return stateless([step](Layers& layers, const Channels&, const FrameInstant&) {
                                 if (step <= 0) return;
                                 for (int row = 0; row < layers.depth_mm.rows; ++row) {
                                   float* depth = layers.depth_mm.ptr<float>(row);
                                   for (int col = 0; col < layers.depth_mm.cols; ++col) {
                                     if (!layers.valid(row, col)) continue;
                                     depth[col] = static_cast<float>(step * std::nearbyint(depth[col] / step));
                                   }
                                 }
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
