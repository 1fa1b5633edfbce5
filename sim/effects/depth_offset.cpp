// Depth offset: the origin of depth lies in front of or behind the camera's centre (the housing's reference plane, a
// delay in a time-of-flight sensor).
//
//   z' = z + offset
#include "sim/effect.h"

namespace binrig::effects {

const Effect& depth_offset() {
  static const Effect effect{
      {.name = "depth_offset",
       .phenomenon = "All depths are wrong by the same length.",
       .stage = Stage::geometry,
       .formula = "z' = z + offset",
       .citation = "plain geometry: the reference plane of depth is not the centre of projection",
       .deviation = "",
       .parameters = {{.name = "offset",
                       .unit = "mm",
                       .lower = -50,
                       .upper = 50,
                       .typical_low = 0.2,
                       .typical_high = 5,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 1,
                       .meaning = "length added to every depth"}},
       .neighbourhood_px = 0,
       .amplitude = "offset",
       .revealed_by = "planes at three distances or more"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float offset = static_cast<float>(instance.value("offset"));
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int) { return [offset](float z, int) { return z + offset; }; });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
