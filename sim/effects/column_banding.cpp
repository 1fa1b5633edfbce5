// Column banding: a standing wave across the image, from the read-out or from the projected pattern's own period. It
// stays where it is whatever the distance, which tells it from pixel_locking.
//
//   z' = z + amplitude cos(2 pi u / period + phase),   u = column index
#include <numbers>
#include <vector>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& column_banding() {
  static const Effect effect{
      {.name = "column_banding",
       .phenomenon = "Depth carries fixed waves along the rows of the image.",
       .stage = Stage::geometry,
       .formula = "z' = z + amplitude cos(2 pi u / period + phase)",
       .citation = "plain periodic error; gives one spectral line of power (amplitude/2)^2 on each side at 1/period",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 50,
                       .typical_low = 0.03,
                       .typical_high = 1,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "height of the wave"},
                      {.name = "period",
                       .unit = "px",
                       .lower = 2,
                       .upper = 2000,
                       .typical_low = 4,
                       .typical_high = 80,
                       .initial = 16,
                       .log_scaled = true,
                       .interpolate = false,
                       .meaning = "length of the wave"},
                      {.name = "phase",
                       .unit = "rad",
                       .lower = -std::numbers::pi,
                       .upper = std::numbers::pi,
                       .typical_low = 0.0,
                       .typical_high = std::numbers::pi,
                       .initial = 0,
                       .kind = ParameterKind::phase,
                       .meaning = "where the wave begins"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .revealed_by = "repeated frames of a plane: a line in the spectrum of their mean"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double amplitude = instance.value("amplitude"), period = instance.value("period");
        const double phase = instance.value("phase");
        std::vector<float> wave(context.camera.width);
        for (std::size_t i = 0; i < wave.size(); ++i) {
          wave[i] = static_cast<float>(amplitude * std::cos(2 * std::numbers::pi * i / period + phase));
        }
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers, [&](int) { return [w = wave.data()](float z, int col) { return z + w[col]; }; });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
