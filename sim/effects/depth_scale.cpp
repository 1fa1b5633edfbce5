// Depth scale: the length unit of the sensor is off by a constant factor (focal length or baseline calibrated wrongly,
// seen along the axis).
//
//   z' = z (1 + scale)
#include "sim/effect.h"

namespace binrig::effects {

const Effect& depth_scale() {
  static const Effect effect{
      {.name = "depth_scale",
       .phenomenon = "All depths are wrong by the same share.",
       .stage = Stage::geometry,
       .formula = "z' = z (1 + scale)",
       .citation = "triangulation z = f B / d: a relative error of f or B is one of z; plain geometry",
       .deviation = "",
       .parameters = {{.name = "scale",
                       .unit = "1",
                       .lower = -0.2,
                       .upper = 0.2,
                       .typical_low = 0.0005,
                       .typical_high = 0.01,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.002,
                       .meaning = "relative error of depth"}},
       .neighbourhood_px = 0,
       .amplitude = "scale",
       .revealed_by = "planes at three distances or more"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float factor = static_cast<float>(1 + instance.value("scale"));
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int) { return [factor](float z, int) { return z * factor; }; });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
