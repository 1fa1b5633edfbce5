// Dead pixels: pixels that never measure. They belong to the unit.
//
//   invalid (defect) at fixed places, each with probability rate
#include <opencv2/core.hpp>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& dead_pixels() {
  static const Effect effect{{.name = "dead_pixels",
                              .phenomenon = "Single pixels never give depth.",
                              .stage = Stage::device,
                              .formula = "invalid at fixed places, each pixel with probability rate",
                              .citation = "plain defect map, as in EMVA Standard 1288 (defect pixels)",
                              .deviation = "",
                              .parameters = {{.name = "rate",
                                              .unit = "1",
                                              .lower = 0,
                                              .upper = 0.5,
                                              .typical_low = 0.0001,
                                              .typical_high = 0.01,
                                              .neutral = 0.0,
                                              .initial = 0.001,
                                              .meaning = "share of dead pixels"}},
                              .neighbourhood_px = 0,
                              .reason = Reason::defect,
                              .amplitude = "rate",
                              .per_unit_map = true,
                              .revealed_by = "any targets: holes that are common to all captures"},
                             [](const EffectInstance& instance, const CaptureContext& context) {
                               cv::Mat draw(context.camera.height, context.camera.width, CV_32F);
                               context.unit_draws().fill_uniform(draw);
                               const cv::Mat dead = draw < instance.value("rate");
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
                                 invalidate_where(layers, Reason::defect, [&](int row) {
                                   return [d = dead.ptr<std::uint8_t>(row)](int col) { return d[col] != 0; };
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
