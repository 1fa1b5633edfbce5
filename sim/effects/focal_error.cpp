// Focal error: the camera file gives a focal length that the lens does not have, so that a pixel looks along another
// ray than it says.
//
//   pixel x looks along the ray (1 + error) x
//
// Everything is that of the scene along the true ray, see OtherView.
#include "core/error.h"
#include "sim/effect.h"

namespace binrig::effects {
namespace {

class FocalError : public OtherView {
 public:
  FocalError(const EffectInstance& instance, const CaptureContext& context) : context_(context) {
    if (!context.render) throw Error(instance.where + ": " + instance.id + " needs a scene that can be rendered");
    view_.camera = context.camera;
    view_.camera.fx /= 1 + instance.value("error");
    view_.camera.fy /= 1 + instance.value("error");
    view_.wanted = context.wanted;
  }

 private:
  std::shared_ptr<const Channels> look(const FrameInstant& instant) override {
    if (!fixed_ || context_.motion) fixed_ = context_.render(view_, instant.number);
    return fixed_;
  }

  const CaptureContext& context_;
  View view_;
  std::shared_ptr<const Channels> fixed_;
};

}  // namespace

const Effect& focal_error() {
  static const Effect effect{
      {.name = "focal_error",
       .phenomenon = "The stated focal length is wrong: tilts and edges come out at the wrong place.",
       .stage = Stage::view,
       .formula = "the scene along the ray ((1 + error) x, (1 + error) y, 1) where the camera file says (x, y, 1)",
       .citation = "plain pinhole geometry",
       .deviation = "",
       .parameters = {{.name = "error",
                       .unit = "1",
                       .lower = -0.3,
                       .upper = 0.3,
                       .typical_low = 0.002,
                       .typical_high = 0.06,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.01,
                       .meaning =
                           "relative error; > 0: true rays spread wider, things look smaller and edges move inwards"}},
       .neighbourhood_px = 0,
       .amplitude = "error",
       .may_clear = true,
       .revealed_by = "planes at two tilts, or edges all over the view"},
      [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
        return std::make_unique<FocalError>(instance, context);
      }};
  return effect;
}

}  // namespace binrig::effects
