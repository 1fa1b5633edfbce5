// Depth warp: a calibration error that depends on the pixel and grows with the distance from the distance at which the
// sensor was calibrated.
//
//   z' = z (1 + g(x, y) (z/z0 - 1)),   g = x_term x + y_term y + xx_term x^2 + xy_term x y + yy_term y^2
//
// x, y: image coordinates from the principal point divided by half the width.
#include "sim/effect.h"

namespace binrig::effects {

const Effect& depth_warp() {
  static const Effect effect{
      {.name = "depth_warp",
       .phenomenon = "Planes are bent, the more so the further they are from the reference distance.",
       .stage = Stage::geometry,
       .formula = "z' = z (1 + g (z/z0 - 1)), g = x_term x + y_term y + xx_term x^2 + xy_term x y + yy_term y^2",
       .citation = "after Teichman, Miller and Thrun, Unsupervised intrinsic calibration of depth sensors via SLAM, "
                   "RSS 2013 (CLAMS)",
       .deviation = "a polynomial in the image instead of their free map of multipliers over pixels and distances",
       .parameters = {{.name = "x_term",
                       .unit = "1",
                       .lower = -0.2,
                       .upper = 0.2,
                       .typical_low = 0.001,
                       .typical_high = 0.01,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.003,
                       .meaning = "coefficient of x"},
                      {.name = "y_term",
                       .unit = "1",
                       .lower = -0.2,
                       .upper = 0.2,
                       .typical_low = 0.001,
                       .typical_high = 0.01,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0,
                       .meaning = "coefficient of y"},
                      {.name = "xx_term",
                       .unit = "1",
                       .lower = -0.2,
                       .upper = 0.2,
                       .typical_low = 0.001,
                       .typical_high = 0.01,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0,
                       .meaning = "coefficient of x^2"},
                      {.name = "xy_term",
                       .unit = "1",
                       .lower = -0.2,
                       .upper = 0.2,
                       .typical_low = 0.001,
                       .typical_high = 0.01,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0,
                       .meaning = "coefficient of x y"},
                      {.name = "yy_term",
                       .unit = "1",
                       .lower = -0.2,
                       .upper = 0.2,
                       .typical_low = 0.001,
                       .typical_high = 0.01,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0,
                       .meaning = "coefficient of y^2"}},
       .neighbourhood_px = 0,
       .amplitude = "x_term",
       .revealed_by = "planes that fill the view, at three distances"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const auto term = [&](const char* name) { return static_cast<float>(instance.value(name)); };
        const float ax = term("x_term"), ay = term("y_term"), axx = term("xx_term"), axy = term("xy_term"),
                    ayy = term("yy_term");
        const float per_z0 = static_cast<float>(1 / context.reference_distance_mm);
        const ImageCoordinates image(context.camera);
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int row) {
            const float y = static_cast<float>(image.y(row)), x0 = static_cast<float>(image.x(0));
            const float dx = static_cast<float>(image.scale);
            const float constant = y * (ay + ayy * y), linear = ax + axy * y;
            return [=](float z, int col) {
              const float x = x0 + dx * col;
              return z * (1.f + (constant + x * (linear + axx * x)) * (z * per_z0 - 1.f));
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
