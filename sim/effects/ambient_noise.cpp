// Ambient noise: sunlight or a lamp in a part of the view adds its shot noise where the pattern is weak.
//
//   sigma'^2 = sigma^2 (1 + amplitude A(x, y) (0.4 / I)^2),   A = exp(-((x - x0)^2 + (y - y0)^2) / (2 radius^2))
//
// x, y: image coordinates from the principal point divided by half the width.
#include <algorithm>
#include <vector>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& ambient_noise() {
  static const Effect effect{
      {.name = "ambient_noise",
       .phenomenon = "Foreign light makes one region noisy, most of all on dark surfaces.",
       .stage = Stage::amplitude,
       .formula =
           "sigma'^2 = sigma^2 (1 + amplitude A (0.4 / max(I, 0.01))^2), A = Gaussian lobe at (centre_x, centre_y)",
       .citation = "plain shot noise of a background (EMVA Standard 1288): its variance stands against the square of "
                   "the signal",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "1",
                       .lower = 0,
                       .upper = 20,
                       .typical_low = 0.2,
                       .typical_high = 2,
                       .neutral = 0.0,
                       .initial = 0.5,
                       .meaning = "variance added in the lobe at I = 0.4, relative to the noise without it"},
                      {.name = "centre_x",
                       .unit = "1",
                       .lower = -2,
                       .upper = 2,
                       .typical_low = 0,
                       .typical_high = 1,
                       .either_sign = true,
                       .initial = 0,
                       .interpolate = false,
                       .meaning = "place of the lobe, halves of the width from the principal point"},
                      {.name = "centre_y",
                       .unit = "1",
                       .lower = -2,
                       .upper = 2,
                       .typical_low = 0,
                       .typical_high = 1,
                       .either_sign = true,
                       .initial = 0,
                       .interpolate = false,
                       .meaning = "place of the lobe, halves of the width from the principal point"},
                      {.name = "radius",
                       .unit = "1",
                       .lower = 0.02,
                       .upper = 5,
                       .typical_low = 0.1,
                       .typical_high = 1,
                       .initial = 0.4,
                       .log_scaled = true,
                       .interpolate = false,
                       .meaning = "standard deviation of the lobe, halves of the width"}},
       .reads = Channel::depth | Channel::ir,
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .needs = {.ir = true},
       .revealed_by = "repeated frames of a plane and of a dark target, with and without the light"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double amplitude = instance.value("amplitude"), x0 = instance.value("centre_x"),
                     y0 = instance.value("centre_y");
        const double inverse = 0.5 / (instance.value("radius") * instance.value("radius"));
        const ImageCoordinates image(context.camera);
        // The lobe is a product of one curve along x and one along y.
        std::vector<float> along_x(context.camera.width), along_y(context.camera.height);
        for (int col = 0; col < context.camera.width; ++col) {
          along_x[col] = static_cast<float>(std::exp(-inverse * (image.x(col) - x0) * (image.x(col) - x0)));
        }
        for (int row = 0; row < context.camera.height; ++row) {
          along_y[row] = static_cast<float>(amplitude * std::exp(-inverse * (image.y(row) - y0) * (image.y(row) - y0)));
        }
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          scale_sigma(layers, [&](int row) {
            return [ir = channels.ir.ptr<float>(row), a = along_y[row], lobe = along_x.data()](int col) {
              const float ratio = 0.4f / std::max(ir[col], 0.01f);
              return std::sqrt(1.f + a * lobe[col] * ratio * ratio);
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
