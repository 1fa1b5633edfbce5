// Low-signal drop-out: where the pattern comes back too weak, the matcher finds nothing; near the threshold it
// flickers.
//
//   invalid (low_signal) where I (1 + 0.15 n) < threshold,   n ~ N(0, 1) a pixel and frame, I at least 0.01
#include <algorithm>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& low_signal_dropout() {
  static const Effect effect{
      {.name = "low_signal_dropout",
       .phenomenon = "Dark surfaces have holes that flicker at their rim.",
       .stage = Stage::signal_mask,
       .formula = "invalid where max(I, 0.01) (1 + 0.15 n) < threshold, n ~ N(0, 1) a pixel and frame",
       .citation = "plain detection threshold with a signal that fluctuates by 15 %",
       .deviation = "",
       .parameters = {{.name = "threshold",
                       .unit = "1",
                       .lower = 0,
                       .upper = 2,
                       .typical_low = 0.02,
                       .typical_high = 0.3,
                       .neutral = 0.0,
                       .initial = 0.06,
                       .meaning = "least infra-red intensity that gives depth"}},
       .reads = Channel::depth | Channel::ir,
       .neighbourhood_px = 0,
       .reason = Reason::low_signal,
       .amplitude = "threshold",
       .needs = {.ir = true},
       .revealed_by = "a dark target, or a chart down to black"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float threshold = static_cast<float>(instance.value("threshold"));
        const CaptureContext* capture = &context;
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant& instant) {
          cv::Mat n(layers.depth_mm.size(), CV_32F);
          capture->draws(instant.number).fill_normal(n);
          invalidate_where(layers, Reason::low_signal, [&](int row) {
            const float *ir = channels.ir.ptr<float>(row), *normal = n.ptr<float>(row);
            return [=](int col) { return std::max(ir[col], 0.01f) * (1.f + 0.15f * normal[col]) < threshold; };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
