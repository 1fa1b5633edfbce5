// Border band: at one border the second view (or the projector) does not look, in a band as wide as a disparity.
//
//   invalid (border) where u < width z0 / z, counted from the left for a projector at +x, from the right for one at -x
#include "sim/effect.h"

namespace binrig::effects {

const Effect& border_band() {
  static const Effect effect{
      {.name = "border_band",
       .phenomenon = "A band at one border has no depth, wider for near things.",
       .stage = Stage::device,
       .formula = "invalid where u < width z0 / z (mirrored for a projector at -x)",
       .citation = "plain overlap of two views: the band is a disparity, f B / z",
       .deviation = "",
       .parameters = {{.name = "width",
                       .unit = "px",
                       .lower = 0,
                       .upper = 2000,
                       .typical_low = 3,
                       .typical_high = 30,
                       .neutral = 0.0,
                       .initial = 10,
                       .meaning = "width of the band at the reference distance"}},
       .neighbourhood_px = 0,
       .reason = Reason::border,
       .amplitude = "width",
       .revealed_by = "any target that fills the view, at two distances"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float area = static_cast<float>(instance.value("width") * context.reference_distance_mm);
        const bool mirrored = context.projector_xyz_mm && context.projector_xyz_mm->x() < 0;
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          invalidate_where(layers, Reason::border, [&](int row) {
            return [z = layers.depth_mm.ptr<float>(row), area, mirrored, right = layers.depth_mm.cols - 1](int col) {
              return static_cast<float>(mirrored ? right - col : col) * z[col] < area;
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
