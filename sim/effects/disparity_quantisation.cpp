// disparity_quantisation: disparity comes in whole fractions of a pixel.
//
// Phenomenon: the matcher interpolates disparity only to a fraction of a pixel, so that depth comes in steps of
// z^2 step / (f B), which grow with the square of the distance.
// Model: d = f B / z, d' = step * round(d / step), at least one step; z' = f B / d'.
//   | step | px | 0 = absent; 1/8 px for Kinect v1 |
// Source: K. Konolige, P. Mihelich, "Technical description of Kinect calibration" (ROS wiki, 2011): 1/8 px.
// We deviate: d = f B / z without Kinect's disparity offset, whose fraction only moves the teeth; a disparity below
// half a step becomes one step (the farthest depth there is) instead of infinite depth. Not for: cameras whose baseline
// is unknown (the effect is then inactive), or a comb that stays where it is when the distance changes (depth_units).
#include "core/error.h"
#include "sim/effect.h"

namespace binrig::effects {

namespace {

EffectDeclaration declare() {
  EffectDeclaration d;
  d.name = "disparity_quantisation";
  d.phenomenon = "Disparity comes in whole fractions of a pixel, so that depth has steps that grow with z^2.";
  d.stage = Stage::quantise;
  d.formula = "d = f B / z, d' = step * max(1, round(d / step)), z' = f B / d'";
  d.citation = "Konolige, Mihelich: Technical description of Kinect calibration, 2011";
  d.deviation = "no disparity offset; a disparity below half a step becomes one step";
  d.parameters = {{.name = "step",
                   .unit = "px",
                   .lower = 0,
                   .upper = 8,
                   .typical_low = 1.0 / 64,
                   .typical_high = 0.5,
                   .neutral = 0.0,
                   .initial = 0.125,
                   .log_scaled = true,
                   .interpolate = false,
                   .meaning = "the step of disparity; 0 = none"}};
  d.amplitude = "step";
  d.needs.baseline = true;
  d.revealed_by = "slightly tilted planes at two distances";
  return d;
}

}  // namespace

const Effect& disparity_quantisation() {
  static const Effect effect{declare(), [](const EffectInstance& instance, const CaptureContext& context) {
                               const double step = instance.value("step"), focal_baseline = context.focal_baseline();
                               if (focal_baseline <= 0) {
                                 throw Error("disparity_quantisation needs the projector's place",
                                             {{.where = instance.where,
                                               .key = instance.id,
                                               .value = {},
                                               .unit = {},
                                               .bounds = {},
                                               .message = "neither model nor recording says where the projector is"}});
                               }
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
                                 if (step <= 0) return;
                                 for (int row = 0; row < layers.depth_mm.rows; ++row) {
                                   float* depth = layers.depth_mm.ptr<float>(row);
                                   for (int col = 0; col < layers.depth_mm.cols; ++col) {
                                     if (!layers.valid(row, col) || depth[col] <= 0) continue;
                                     const double steps =
                                         std::max(1.0, std::nearbyint(focal_baseline / depth[col] / step));
                                     depth[col] = static_cast<float>(focal_baseline / (steps * step));
                                   }
                                 }
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
