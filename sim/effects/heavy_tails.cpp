// Heavy tails: some of the noise is not Gaussian; single pixels scatter several times as much for a frame.
//
//   with probability rate (a pixel and frame): sigma' = factor sigma
#include "sim/effect.h"

namespace binrig::effects {

const Effect& heavy_tails() {
  static const Effect effect{
      {.name = "heavy_tails",
       .phenomenon = "Now and then the noise of a pixel is several times its usual size.",
       .stage = Stage::amplitude,
       .formula = "with probability rate (a pixel and frame), sigma' = factor sigma",
       .citation =
           "contaminated normal distribution: Tukey, A survey of sampling from contaminated distributions, 1960",
       .deviation = "",
       .parameters = {{.name = "rate",
                       .unit = "1",
                       .lower = 0,
                       .upper = 0.5,
                       .typical_low = 0.001,
                       .typical_high = 0.05,
                       .neutral = 0.0,
                       .initial = 0.01,
                       .log_scaled = true,
                       .meaning = "share of pixels with large noise"},
                      {.name = "factor",
                       .unit = "1",
                       .lower = 1,
                       .upper = 50,
                       .typical_low = 3,
                       .typical_high = 10,
                       .initial = 4,
                       .log_scaled = true,
                       .meaning = "how much larger their noise is"}},
       .neighbourhood_px = 0,
       .amplitude = "rate",
       .revealed_by = "repeated frames of a plane: kurtosis"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float rate = static_cast<float>(instance.value("rate")),
                    factor = static_cast<float>(instance.value("factor"));
        const CaptureContext* capture = &context;
        return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
          cv::Mat draw(layers.depth_mm.size(), CV_32F);
          capture->draws(instant.number).fill_uniform(draw);
          scale_sigma(layers, [&](int row) {
            return [u = draw.ptr<float>(row), rate, factor](int col) { return u[col] < rate ? factor : 1.f; };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
