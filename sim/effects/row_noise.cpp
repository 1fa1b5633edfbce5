// Row noise: rows share a noise of their own, new in every frame (read-out by row).
//
//   z' = z + n(v),   n ~ N(0, amplitude^2), one number a row and frame
#include "sim/effect.h"

namespace binrig::effects {

const Effect& row_noise() {
  static const Effect effect{{.name = "row_noise",
                              .phenomenon = "Whole rows jump up and down from frame to frame.",
                              .stage = Stage::noise,
                              .formula = "z' = z + n, n ~ N(0, amplitude^2), one number a row and frame",
                              .citation = "plain row noise of a read-out",
                              .deviation = "",
                              .parameters = {{.name = "amplitude",
                                              .unit = "mm",
                                              .lower = 0,
                                              .upper = 50,
                                              .typical_low = 0.02,
                                              .typical_high = 0.5,
                                              .neutral = 0.0,
                                              .initial = 0.1,
                                              .meaning = "standard deviation from row to row"}},
                              .neighbourhood_px = 0,
                              .amplitude = "amplitude",
                              .revealed_by = "repeated frames of a plane: a ridge in the spectrum"},
                             [](const EffectInstance& instance, const CaptureContext& context) {
                               const float amplitude = static_cast<float>(instance.value("amplitude"));
                               const CaptureContext* capture = &context;
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
                                 const RandomStream draws = capture->draws(instant.number);
                                 for_rows(layers.noise_mm.size(), [&](int first, int last) {
                                   for (int row = first; row < last; ++row) {
                                     const float step = amplitude * static_cast<float>(draws.normal(row));
                                     float* noise = layers.noise_mm.ptr<float>(row);
                                     for (int col = 0; col < layers.noise_mm.cols; ++col) noise[col] += step;
                                   }
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
