// Low-signal noise: less light, more noise (shot noise: variance in proportion to 1 / I).
//
//   sigma'^2 = sigma^2 max(0.2, 1 + amplitude (0.4 / I - 1)),   I = infra-red intensity, at least 0.01
//
// At I = 0.4 nothing changes; amplitude 1 is pure shot noise.
#include <algorithm>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& low_signal_noise() {
  static const Effect effect{
      {.name = "low_signal_noise",
       .phenomenon = "Noise grows on dark surfaces.",
       .stage = Stage::amplitude,
       .formula = "sigma'^2 = sigma^2 max(0.2, 1 + amplitude (0.4 / max(I, 0.01) - 1))",
       .citation = "plain shot noise: signal I, noise sqrt(I), so that the variance of a position goes with 1/I (EMVA "
                   "Standard 1288)",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "1",
                       .lower = 0,
                       .upper = 5,
                       .typical_low = 0.1,
                       .typical_high = 1.5,
                       .neutral = 0.0,
                       .initial = 0.5,
                       .meaning = "share of the variance that goes with 1/I"}},
       .reads = Channel::depth | Channel::ir,
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .needs = {.ir = true},
       .revealed_by = "repeated frames of a chart of several albedos"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float a = static_cast<float>(instance.value("amplitude"));
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          scale_sigma(layers, [&](int row) {
            return [ir = channels.ir.ptr<float>(row), a](int col) {
              return std::sqrt(std::max(0.2f, 1.f + a * (0.4f / std::max(ir[col], 0.01f) - 1.f)));
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
