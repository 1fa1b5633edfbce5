// Depth nonlinearity: depth is right at the reference distance and curves away from the truth on both sides of it.
//
//   z' = z + amplitude ((z - z0) / 100 mm)^2
#include "sim/effect.h"

namespace binrig::effects {

const Effect& depth_nonlinearity() {
  static const Effect effect{
      {.name = "depth_nonlinearity",
       .phenomenon = "The depth error is curved in the distance.",
       .stage = Stage::geometry,
       .formula = "z' = z + amplitude ((z - z0) / 100 mm)^2",
       .citation = "plain power series about the reference distance; its lower terms are depth_offset and depth_scale",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = -20,
                       .upper = 20,
                       .typical_low = 0.1,
                       .typical_high = 2,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.3,
                       .meaning = "error 100 mm off the reference distance"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .revealed_by = "planes at five distances"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float a = static_cast<float>(instance.value("amplitude"));
        const float z0 = static_cast<float>(context.reference_distance_mm);
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int) {
            return [a, z0](float z, int) {
              const float step = (z - z0) * 0.01f;
              return z + a * step * step;
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
