// Random drop-out: pixels are lost one by one, independently, in every frame.
//
//   invalid (dropped) with probability rate, a pixel and frame
#include "sim/effect.h"

namespace binrig::effects {

const Effect& random_dropout() {
  static const Effect effect{{.name = "random_dropout",
                              .phenomenon = "Pixels flicker out at random.",
                              .stage = Stage::device,
                              .formula = "invalid with probability rate, a pixel and frame",
                              .citation = "plain independent loss (Bernoulli)",
                              .deviation = "",
                              .parameters = {{.name = "rate",
                                              .unit = "1",
                                              .lower = 0,
                                              .upper = 0.9,
                                              .typical_low = 0.001,
                                              .typical_high = 0.05,
                                              .neutral = 0.0,
                                              .initial = 0.01,
                                              .meaning = "share of pixels lost in a frame"}},
                              .neighbourhood_px = 0,
                              .reason = Reason::dropped,
                              .amplitude = "rate",
                              .revealed_by = "repeated frames of any target"},
                             [](const EffectInstance& instance, const CaptureContext& context) {
                               const float rate = static_cast<float>(instance.value("rate"));
                               const CaptureContext* capture = &context;
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
                                 cv::Mat draw(layers.depth_mm.size(), CV_32F);
                                 capture->draws(instant.number).fill_uniform(draw);
                                 invalidate_where(layers, Reason::dropped, [&](int row) {
                                   return [u = draw.ptr<float>(row), rate](int col) { return u[col] < rate; };
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
