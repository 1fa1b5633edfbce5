// Second shadow: a second camera (or projector) at B2 must see the point as well; what it does not see has no depth.
//
//   invalid (second_shadow) where a light at (baseline, 0, 0) would throw a shadow
//
// It lies on the other side of a thing than the projector's shadow where the two stand on different sides.
#include "core/error.h"
#include "sim/effect.h"

namespace binrig::effects {
namespace {

class SecondShadow : public Run {
 public:
  SecondShadow(const EffectInstance& instance, const CaptureContext& context) : context_(context) {
    if (!context.render) throw Error(instance.where + ": " + instance.id + " needs a scene that can be rendered");
    view_.camera = context.camera;
    view_.projector_xyz_mm = Vector3(instance.value("baseline"), 0, 0);
    view_.wanted = Channel::depth | Channel::projector_gap;
  }

  void apply(Layers& layers, const Channels&, const FrameInstant& instant) override {
    if (!seen_ || context_.motion) seen_ = context_.render(view_, instant.number);
    invalidate_where(layers, Reason::second_shadow, [&](int row) {
      const float* gap = seen_->projector_gap_mm.ptr<float>(row);
      return [gap](int col) { return gap[col] > shadow_epsilon_mm; };
    });
  }

 private:
  const CaptureContext& context_;
  View view_;
  std::shared_ptr<const Channels> seen_;
};

}  // namespace

const Effect& second_shadow() {
  static const Effect effect{
      {.name = "second_shadow",
       .phenomenon = "A second camera does not see everything that the first one sees.",
       .stage = Stage::signal_mask,
       .formula = "invalid where the point is hidden from (baseline, 0, 0), a point beside the camera",
       .citation = "plain geometry of two views; rendered as a shadow (Williams, SIGGRAPH 1978)",
       .deviation = "",
       .parameters = {{.name = "baseline",
                       .unit = "mm",
                       .lower = -500,
                       .upper = 500,
                       .typical_low = 20,
                       .typical_high = 110,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 50,
                       .interpolate = false,
                       .meaning = "x of the second view in the camera frame; its sign is the side"}},
       .reads = static_cast<ChannelSet>(Channel::depth),
       .neighbourhood_px = 0,
       .reason = Reason::second_shadow,
       .amplitude = "baseline",
       .needs = {.baseline = true},
       .revealed_by = "a step or a box on a plane: shadows on both sides"},
      [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
        return std::make_unique<SecondShadow>(instance, context);
      }};
  return effect;
}

}  // namespace binrig::effects
