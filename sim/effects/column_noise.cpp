// Column noise: columns share a noise of their own, new in every frame (read-out by column).
//
//   z' = z + n(u),   n ~ N(0, amplitude^2), one number a column and frame
#include <vector>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& column_noise() {
  static const Effect effect{{.name = "column_noise",
                              .phenomenon = "Whole columns jump up and down from frame to frame.",
                              .stage = Stage::noise,
                              .formula = "z' = z + n, n ~ N(0, amplitude^2), one number a column and frame",
                              .citation = "plain column noise of a read-out",
                              .deviation = "",
                              .parameters = {{.name = "amplitude",
                                              .unit = "mm",
                                              .lower = 0,
                                              .upper = 50,
                                              .typical_low = 0.02,
                                              .typical_high = 0.5,
                                              .neutral = 0.0,
                                              .initial = 0.1,
                                              .meaning = "standard deviation from column to column"}},
                              .neighbourhood_px = 0,
                              .amplitude = "amplitude",
                              .revealed_by = "repeated frames of a plane: a ridge in the spectrum"},
                             [](const EffectInstance& instance, const CaptureContext& context) {
                               const float amplitude = static_cast<float>(instance.value("amplitude"));
                               const CaptureContext* capture = &context;
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
                                 const RandomStream draws = capture->draws(instant.number);
                                 std::vector<float> step(layers.noise_mm.cols);
                                 for (std::size_t col = 0; col < step.size(); ++col)
                                   step[col] = amplitude * static_cast<float>(draws.normal(col));
                                 for_rows(layers.noise_mm.size(), [&](int first, int last) {
                                   for (int row = first; row < last; ++row) {
                                     float* noise = layers.noise_mm.ptr<float>(row);
                                     for (int col = 0; col < layers.noise_mm.cols; ++col) noise[col] += step[col];
                                   }
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
