// Incidence noise: on slanted surfaces the matching window covers a range of disparities.
//
//   sigma'^2 = sigma^2 (1 + amplitude (theta / (pi/2 - theta))^2),   theta = incidence, at most 1.4 rad
#include <algorithm>
#include <numbers>
#include <vector>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& incidence_noise() {
  static const Effect effect{
      {.name = "incidence_noise",
       .phenomenon = "Noise grows on surfaces seen at an angle.",
       .stage = Stage::amplitude,
       .formula = "sigma'^2 = sigma^2 (1 + amplitude (theta / (pi/2 - theta))^2), theta <= 1.4 rad",
       .citation = "Nguyen, Izadi and Lovell, Modeling Kinect sensor noise for improved 3D reconstruction and "
                   "tracking, 3DIMPVT 2012",
       .deviation =
           "their term in the standard deviation of Kinect v1 becomes one in the variance, relative to frontal noise",
       .parameters = {{.name = "amplitude",
                       .unit = "1",
                       .lower = 0,
                       .upper = 30,
                       .typical_low = 0.1,
                       .typical_high = 3,
                       .neutral = 0.0,
                       .initial = 0.5,
                       .meaning = "variance added, relative to frontal, at theta = pi/4"}},
       .reads = Channel::depth | Channel::cos_incidence,
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .revealed_by = "repeated frames of planes at several tilts"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float a = static_cast<float>(instance.value("amplitude"));
        // One table over the cosine saves an acos per pixel; between its 4096 steps the factor is linear to 1e-3.
        constexpr int steps = 4096;
        std::vector<float> table(steps + 2);
        for (int i = 0; i <= steps + 1; ++i) {
          const double theta = std::min(std::acos(std::min(1.0, i / static_cast<double>(steps))), 1.4);
          const double q = theta / (std::numbers::pi / 2 - theta);
          table[i] = static_cast<float>(std::sqrt(1 + a * q * q));
        }
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          scale_sigma(layers, [&](int row) {
            return [c = channels.cos_incidence.ptr<float>(row), t = table.data()](int col) {
              const float position = std::clamp(c[col], 0.f, 1.f) * steps;
              const int i = static_cast<int>(position);
              return t[i] + (position - i) * (t[i + 1] - t[i]);
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
