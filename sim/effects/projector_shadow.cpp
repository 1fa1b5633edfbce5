// Projector shadow: what the projector does not light cannot be matched.
//
//   invalid (shadow) where gap > bias, gap = how far the point lies behind the first surface that the projector sees
//
// A real matcher still matches a little way into the shadow, since its window reaches over the rim: the bias (mm). The
// side of the shadow is the projector's; the place of the projector belongs to the model.
#include "sim/effect.h"

namespace binrig::effects {

const Effect& projector_shadow() {
  static const Effect effect{
      {.name = "projector_shadow",
       .phenomenon = "The projector stands beside the camera, so that edges throw shadows in which there is no depth.",
       .stage = Stage::signal_mask,
       .formula = "invalid where gap > bias; gap = distance of the point behind the first surface the projector sees",
       .citation =
           "Williams, Casting curved shadows on curved surfaces, SIGGRAPH 1978 (depth-shadow test and its bias)",
       .deviation = "the gap comes exact from the renderer; the bias is the sensor's, not a guard against shadow acne",
       .parameters = {{.name = "bias",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 10000,
                       .typical_low = 0.1,
                       .typical_high = 3,
                       .neutral = 10000,
                       .initial = 1,
                       .meaning = "points at most this far behind the lit surface still give depth"}},
       .reads = Channel::depth | Channel::projector_gap,
       .neighbourhood_px = 0,
       .reason = Reason::shadow,
       .amplitude = "bias",
       .stronger_is_larger = false,
       .needs = {.baseline = true},
       .revealed_by = "a step or a box on a plane, its edge across the baseline"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float limit = static_cast<float>(instance.value("bias")) + shadow_epsilon_mm;
        return stateless([limit](Layers& layers, const Channels& channels, const FrameInstant&) {
          invalidate_where(layers, Reason::shadow, [&](int row) {
            const float* gap = channels.projector_gap_mm.ptr<float>(row);
            return [gap, limit](int col) { return gap[col] > limit; };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
