// Radial distortion: what is left of the lens distortion moves disparities by an amount that grows towards the corners.
//
//   z' = f B / (d + amplitude r^2),   r^2 = 0 at the principal point, 1 in the corners
//
// Its mean over the image is a disparity_offset of amplitude / 3.
#include "sim/effect.h"

namespace binrig::effects {

const Effect& radial_distortion() {
  static const Effect effect{
      {.name = "radial_distortion",
       .phenomenon = "Left-over lens distortion bends planes into bowls or domes.",
       .stage = Stage::geometry,
       .formula = "z' = f B / (d + amplitude r^2), r^2 = 1 in the corners",
       .citation = "Brown, Close-range camera calibration, Photogrammetric Engineering 37 (1971): radial terms in r^2",
       .deviation = "the first radial term alone, expressed in the disparity that it shifts",
       .parameters = {{.name = "amplitude",
                       .unit = "px",
                       .lower = -5,
                       .upper = 5,
                       .typical_low = 0.01,
                       .typical_high = 0.3,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.05,
                       .meaning = "disparity added in the corners"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .needs = {.baseline = true},
       .revealed_by = "planes that fill the view, at two distances"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float a = static_cast<float>(instance.value("amplitude")),
                    fb = static_cast<float>(context.focal_baseline());
        const ImageCoordinates image(context.camera);
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int row) {
            const float y2 = static_cast<float>(image.y(row) * image.y(row));
            const float x0 = static_cast<float>(image.x(0)), dx = static_cast<float>(image.scale);
            const float corner = static_cast<float>(image.corner);
            return [=](float z, int col) {
              const float x = x0 + dx * col;
              return with_disparity_added(z, a * corner * (x * x + y2), fb);
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
