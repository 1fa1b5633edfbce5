// Mismatch outliers: now and then the matcher takes a wrong peak, and the pixel is far off.
//
//   with probability rate (a pixel and frame): z' = z + distance or z - distance, with equal chances
#include "sim/effect.h"

namespace binrig::effects {

const Effect& mismatch_outliers() {
  static const Effect effect{{.name = "mismatch_outliers",
                              .phenomenon = "Single pixels jump far away from the surface.",
                              .stage = Stage::matching,
                              .formula = "with probability rate, z' = z +- distance",
                              .citation = "plain two-point contamination",
                              .deviation = "",
                              .parameters = {{.name = "rate",
                                              .unit = "1",
                                              .lower = 0,
                                              .upper = 0.2,
                                              .typical_low = 0.0001,
                                              .typical_high = 0.01,
                                              .neutral = 0.0,
                                              .initial = 0.002,
                                              .meaning = "share of pixels that are mismatched"},
                                             {.name = "distance",
                                              .unit = "mm",
                                              .lower = 0.1,
                                              .upper = 1000,
                                              .typical_low = 5,
                                              .typical_high = 100,
                                              .initial = 20,
                                              .log_scaled = true,
                                              .meaning = "how far they are off"}},
                              .neighbourhood_px = 0,
                              .amplitude = "rate",
                              .revealed_by = "repeated frames of a plane: far tails of its residual"},
                             [](const EffectInstance& instance, const CaptureContext& context) {
                               const float rate = static_cast<float>(instance.value("rate")),
                                           distance = static_cast<float>(instance.value("distance"));
                               const CaptureContext* capture = &context;
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
                                 cv::Mat draw(layers.depth_mm.size(), CV_32F);
                                 capture->draws(instant.number).fill_uniform(draw);
                                 map_depth(layers, [&](int row) {
                                   return [u = draw.ptr<float>(row), rate, distance](float z, int col) {
                                     // The same draw decides whether and where to: below half the rate up, above it
                                     // down.
                                     const float step = u[col] < 0.5f * rate ? distance : -distance;
                                     return u[col] < rate ? z + step : z;
                                   };
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
