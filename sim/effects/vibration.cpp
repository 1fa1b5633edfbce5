// Vibration: the whole sensor (or the floor) moves a little, so that a frame is shifted and tilted as one.
//
//   z' = z + offset + tilt_x x + tilt_y y,   each N(0, amplitude^2), new in every frame
//
// x, y: image coordinates from the principal point divided by half the width.
#include "sim/effect.h"

namespace binrig::effects {

const Effect& vibration() {
  static const Effect effect{
      {.name = "vibration",
       .phenomenon = "Whole frames jump and tilt.",
       .stage = Stage::noise,
       .formula = "z' = z + offset + tilt_x x + tilt_y y, each ~ N(0, amplitude^2) a frame",
       .citation = "plain rigid motion to first order",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 50,
                       .typical_low = 0.03,
                       .typical_high = 0.5,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "standard deviation of the shift, and of the tilt over half the width"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .revealed_by = "a long series of a plane"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double amplitude = instance.value("amplitude");
        const ImageCoordinates image(context.camera);
        const CaptureContext* capture = &context;
        return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
          const RandomStream draws = capture->draws(instant.number);
          const double offset = amplitude * draws.normal(0), tilt_x = amplitude * draws.normal(1),
                       tilt_y = amplitude * draws.normal(2);
          const float step = static_cast<float>(tilt_x * image.scale);
          for_rows(layers.noise_mm.size(), [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              const float start = static_cast<float>(offset + tilt_x * image.x(0) + tilt_y * image.y(row));
              float* noise = layers.noise_mm.ptr<float>(row);
              for (int col = 0; col < layers.noise_mm.cols; ++col) noise[col] += start + step * col;
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
