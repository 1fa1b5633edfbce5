// Latency: the depth that a frame carries is older than its time stamp.
//
//   the scene at t - delay, see OtherView
#include "core/error.h"
#include "sim/effect.h"

namespace binrig::effects {
namespace {

class Latency : public OtherView {
 public:
  Latency(const EffectInstance& instance, const CaptureContext& context)
      : context_(context), delay_s_(instance.value("delay")) {
    if (!context.render) throw Error(instance.where + ": " + instance.id + " needs a scene that can be rendered");
  }

 private:
  std::shared_ptr<const Channels> look(const FrameInstant& instant) override {
    View view;
    view.camera = context_.camera;
    view.time_s = instant.time_s - delay_s_;
    view.wanted = context_.wanted;
    return context_.render(view, instant.number);
  }

  const CaptureContext& context_;
  double delay_s_;
};

}  // namespace

const Effect& latency() {
  static const Effect effect{{.name = "latency",
                              .phenomenon = "Moving things appear where they were a moment ago.",
                              .stage = Stage::view,
                              .formula = "the scene of t - delay",
                              .citation = "plain delay",
                              .deviation = "",
                              .parameters = {{.name = "delay",
                                              .unit = "s",
                                              .lower = 0,
                                              .upper = 3,
                                              .typical_low = 0.02,
                                              .typical_high = 0.3,
                                              .neutral = 0.0,
                                              .initial = 0.1,
                                              .meaning = "age of the depth at its time stamp"}},
                              .neighbourhood_px = 0,
                              .amplitude = "delay",
                              .needs = {.motion = true},
                              .may_clear = true,
                              .revealed_by = "a target that moves in a known way"},
                             [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
                               return std::make_unique<Latency>(instance, context);
                             }};
  return effect;
}

}  // namespace binrig::effects
