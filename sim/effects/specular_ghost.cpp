// Specular ghost: the bright core of a highlight drags dots, so that depth beside the saturated hole is bent.
//
//   z' = z + amplitude min(specular / scale, 1.5)
#include <algorithm>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& specular_ghost() {
  static const Effect effect{{.name = "specular_ghost",
                              .phenomenon = "Depth is bent around highlights.",
                              .stage = Stage::matching,
                              .formula = "z' = z + amplitude min(specular / scale, 1.5)",
                              .citation = "plain phenomenological term, linear in the highlight up to its saturation",
                              .deviation = "",
                              .parameters = {{.name = "amplitude",
                                              .unit = "mm",
                                              .lower = -20,
                                              .upper = 20,
                                              .typical_low = 0.2,
                                              .typical_high = 2,
                                              .either_sign = true,
                                              .neutral = 0.0,
                                              .initial = 0.5,
                                              .meaning = "error where specular equals the scale"},
                                             {.name = "scale",
                                              .unit = "1",
                                              .lower = 0.02,
                                              .upper = 5,
                                              .typical_low = 0.3,
                                              .typical_high = 0.9,
                                              .initial = 0.6,
                                              .log_scaled = true,
                                              .meaning = "specular intensity at which the error is the amplitude"}},
                              .reads = Channel::depth | Channel::specular,
                              .neighbourhood_px = 0,
                              .amplitude = "amplitude",
                              .needs = {.ir = true},
                              .revealed_by = "a shiny curved part"},
                             [](const EffectInstance& instance, const CaptureContext&) {
                               const float a = static_cast<float>(instance.value("amplitude")),
                                           inverse = static_cast<float>(1 / instance.value("scale"));
                               return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
                                 map_depth(layers, [&](int row) {
                                   return [s = channels.specular.ptr<float>(row), a, inverse](float z, int col) {
                                     return z + a * std::min(s[col] * inverse, 1.5f);
                                   };
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
