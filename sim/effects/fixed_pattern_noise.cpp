// Fixed pattern noise: every unit carries its own bumpy error map, the same in each capture (spread of the pattern's
// dots, of the reference image, of the pixels).
//
//   z' = z + m(u, v),   m = Gaussian noise through a Gaussian of sigma = correlation_length, scaled to amplitude
//
// The map belongs to the unit (unit_seed), not to the seed of a recording.
#include "core/smooth_noise.h"
#include "sim/effect.h"

namespace binrig::effects {

const Effect& fixed_pattern_noise() {
  static const Effect effect{
      {.name = "fixed_pattern_noise",
       .phenomenon = "Every unit carries its own fixed map of small depth errors.",
       .stage = Stage::geometry,
       .formula =
           "z' = z + m(u, v); m = white noise through a Gaussian of sigma correlation_length, scaled to amplitude",
       .citation = "plain stationary Gaussian field; fixed-pattern noise as in EMVA Standard 1288 (spatial "
                   "non-uniformity), of depth instead of grey values",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 20,
                       .typical_low = 0.02,
                       .typical_high = 0.5,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "standard deviation of the map"},
                      {.name = "correlation_length",
                       .unit = "px",
                       .lower = 0,
                       .upper = 100,
                       .typical_low = 2,
                       .typical_high = 30,
                       .initial = 6,
                       .meaning = "sigma of the Gaussian that smooths the map"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .per_unit_map = true,
       .revealed_by = "repeated frames of planes at several places: what is common to all of them"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        return adding(smooth_noise({context.camera.width, context.camera.height}, instance.value("correlation_length"),
                                   instance.value("amplitude"), context.unit_draws()));
      }};
  return effect;
}

}  // namespace binrig::effects
