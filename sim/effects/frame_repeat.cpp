// Frame repeat: the sensor (or its driver) delivers the last frame once more.
//
//   with the given probability a frame is the one before it, in depth, reasons and infra-red
#include "sim/effect.h"

namespace binrig::effects {
namespace {

class FrameRepeat : public Run {
 public:
  FrameRepeat(const EffectInstance& instance, const CaptureContext& context)
      : context_(context), probability_(instance.value("probability")) {}

  void apply(Layers& layers, const Channels&, const FrameInstant& instant) override {
    if (!depth_.empty() && context_.draws(instant.number).uniform(0) < probability_) {
      depth_.copyTo(layers.depth_mm);
      reason_.copyTo(layers.reason);
      if (!ir_.empty()) ir_.copyTo(layers.ir);
      return;
    }
    layers.depth_mm.copyTo(depth_);
    layers.reason.copyTo(reason_);
    if (!layers.ir.empty()) layers.ir.copyTo(ir_);
  }

 private:
  const CaptureContext& context_;
  double probability_;
  cv::Mat depth_, reason_, ir_;
};

}  // namespace

const Effect& frame_repeat() {
  static const Effect effect{{.name = "frame_repeat",
                              .phenomenon = "Some frames are copies of the one before.",
                              .stage = Stage::temporal,
                              .formula = "with the given probability the last frame again",
                              .citation = "plain repetition, as a driver does that misses a deadline",
                              .deviation = "",
                              .parameters = {{.name = "probability",
                                              .unit = "1",
                                              .lower = 0,
                                              .upper = 1,
                                              .typical_low = 0.05,
                                              .typical_high = 0.5,
                                              .neutral = 0.0,
                                              .initial = 0.2,
                                              .kind = ParameterKind::chance,
                                              .meaning = "share of frames that are repeats"}},
                              .neighbourhood_px = 0,
                              .amplitude = "probability",
                              .needs = {.repeats = true},
                              .may_clear = true,
                              .revealed_by = "a series of any target"},
                             [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
                               return std::make_unique<FrameRepeat>(instance, context);
                             }};
  return effect;
}

}  // namespace binrig::effects
