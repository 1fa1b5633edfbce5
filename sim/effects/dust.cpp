// Dust: a grain on the window hides a spot of the view; its blurred rim is now measured and now not.
//
//   invalid (defect) where distance to (x, y) < radius + 0.7 n,   n ~ N(0, 1) a pixel and frame
//
// x, y: image coordinates from the principal point divided by half the width; the radius is in pixels.
#include <algorithm>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& dust() {
  static const Effect effect{
      {.name = "dust",
       .phenomenon = "A spot that is fixed in the image has no depth; its rim flickers.",
       .stage = Stage::device,
       .formula = "invalid where the distance to (x, y) < radius + 0.7 n px, n ~ N(0, 1) a pixel and frame",
       .citation = "plain occlusion by a blurred disc",
       .deviation = "",
       .parameters = {{.name = "radius",
                       .unit = "px",
                       .lower = 0,
                       .upper = 300,
                       .typical_low = 2,
                       .typical_high = 15,
                       .neutral = 0.0,
                       .initial = 5,
                       .meaning = "radius of the spot"},
                      {.name = "x",
                       .unit = "1",
                       .lower = -2,
                       .upper = 2,
                       .typical_low = 0,
                       .typical_high = 1,
                       .either_sign = true,
                       .initial = 0.3,
                       .interpolate = false,
                       .meaning = "place of the spot, halves of the width from the principal point"},
                      {.name = "y",
                       .unit = "1",
                       .lower = -2,
                       .upper = 2,
                       .typical_low = 0,
                       .typical_high = 1,
                       .either_sign = true,
                       .initial = 0.2,
                       .interpolate = false,
                       .meaning = "place of the spot, halves of the width from the principal point"}},
       .neighbourhood_px = 0,
       .reason = Reason::defect,
       .amplitude = "radius",
       .revealed_by = "any targets: a hole that is common to all captures"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double radius = instance.value("radius");
        const ImageCoordinates image(context.camera);
        const double u0 = image.cx + instance.value("x") / image.scale,
                     v0 = image.cy + instance.value("y") / image.scale;
        const CaptureContext* capture = &context;
        return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
          if (radius <= 0) return;
          const RandomStream draws = capture->draws(instant.number);
          // Draws are keyed by pixel, so that only those that the spot and its rim can reach need to be visited.
          const double reach = radius + 0.7 * 9;
          const int cols = layers.depth_mm.cols;
          const int top = std::max(0, static_cast<int>(std::floor(v0 - reach)));
          const int bottom = std::min(layers.depth_mm.rows - 1, static_cast<int>(std::ceil(v0 + reach)));
          const int left = std::max(0, static_cast<int>(std::floor(u0 - reach)));
          const int right = std::min(cols - 1, static_cast<int>(std::ceil(u0 + reach)));
          for (int row = top; row <= bottom; ++row) {
            for (int col = left; col <= right; ++col) {
              const double from_rim = std::hypot(col - u0, row - v0) - radius;
              if (from_rim > 0.7 * 9) continue;
              const bool hidden =
                  from_rim < -0.7 * 9 || from_rim < 0.7 * draws.normal(static_cast<std::uint64_t>(row) * cols + col);
              if (hidden) layers.invalidate(row, col, Reason::defect);
            }
          }
        });
      }};
  return effect;
}

}  // namespace binrig::effects
