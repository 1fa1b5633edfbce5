// Pixel locking: sub-pixel interpolation of the matching cost pulls disparities towards whole pixels (or away from
// them), so that a tilted plane shows ripples where its disparity passes whole pixels.
//
//   d' = d + amplitude sin(2 pi d + phase),   z' = f B / d'
#include <algorithm>
#include <numbers>

#include "core/image_math.h"
#include "sim/effect.h"

namespace binrig::effects {

const Effect& pixel_locking() {
  static const Effect effect{
      {.name = "pixel_locking",
       .phenomenon = "Sub-pixel matching prefers certain parts of a pixel, which puts ripples on slopes.",
       .stage = Stage::geometry,
       .formula = "z' = f B / (d + amplitude sin(2 pi d + phase)), d = f B / z",
       .citation =
           "Shimizu and Okutomi, Sub-pixel estimation error cancellation on area-based matching, IJCV 63 (2005)",
       .deviation = "the first harmonic of their error curve, with a phase of its own",
       .parameters = {{.name = "amplitude",
                       .unit = "px",
                       .lower = 0,
                       .upper = 0.5,
                       .typical_low = 0.005,
                       .typical_high = 0.1,
                       .neutral = 0.0,
                       .initial = 0.02,
                       .meaning = "largest disparity error"},
                      {.name = "phase",
                       .unit = "rad",
                       .lower = -std::numbers::pi,
                       .upper = std::numbers::pi,
                       .typical_low = 0.0,
                       .typical_high = std::numbers::pi,
                       .initial = 0,
                       .kind = ParameterKind::phase,
                       .meaning = "pi pulls disparities towards whole pixels, 0 towards halves; between them for an "
                                  "asymmetric matcher"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .needs = {.baseline = true},
       .revealed_by = "a tilted plane, and planes at a second distance"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float a = static_cast<float>(instance.value("amplitude")),
                    fb = static_cast<float>(context.focal_baseline());
        const float start = static_cast<float>(instance.value("phase") / (2 * std::numbers::pi));
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int) {
            return
                [=](float z, int) { return with_disparity_added(z, a * sin_turns(fb / std::max(z, 1.f) + start), fb); };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
