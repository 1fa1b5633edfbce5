// No return: polished surfaces throw the pattern past the camera; hardly any light comes back.
//
//   invalid (low_signal) where diffuse + specular < threshold
//
// diffuse and specular: what the surface sends towards the camera, with the projector's shadow left aside.
#include "sim/effect.h"

namespace binrig::effects {

const Effect& no_return() {
  static const Effect effect{{.name = "no_return",
                              .phenomenon = "Polished surfaces that reflect the light elsewhere give no depth.",
                              .stage = Stage::signal_mask,
                              .formula = "invalid where diffuse + specular < threshold",
                              .citation = "thesis 5.3.2, which mentions it without modelling it; light after Phong, "
                                          "Illumination for computer generated pictures, CACM 1975",
                              .deviation = "",
                              .parameters = {{.name = "threshold",
                                              .unit = "1",
                                              .lower = 0,
                                              .upper = 2,
                                              .typical_low = 0.01,
                                              .typical_high = 0.1,
                                              .neutral = 0.0,
                                              .initial = 0.04,
                                              .meaning = "least light towards the camera that gives depth"}},
                              .reads = Channel::depth | Channel::diffuse | Channel::specular,
                              .neighbourhood_px = 0,
                              .reason = Reason::low_signal,
                              .amplitude = "threshold",
                              .needs = {.ir = true},
                              .revealed_by = "a polished metal part in several poses"},
                             [](const EffectInstance& instance, const CaptureContext&) {
                               const float threshold = static_cast<float>(instance.value("threshold"));
                               return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
                                 invalidate_where(layers, Reason::low_signal, [&](int row) {
                                   const float *diffuse = channels.diffuse.ptr<float>(row),
                                               *specular = channels.specular.ptr<float>(row);
                                   return [=](int col) { return diffuse[col] + specular[col] < threshold; };
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
