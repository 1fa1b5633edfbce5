// Speckle noise: projected light meets each scene with another grain (laser speckle, and which dots fall on what), and
// the match is off by as much as the grain says. Nothing moves: the error stays. Something moves: it is another one.
//
//   z' = z + s(u, v),   s = Gaussian noise through a Gaussian of sigma = correlation_length, scaled to amplitude
//
// As bumpy as fixed_pattern_noise, but of the scene, not of the unit: two captures of one unit have nothing in common.
#include "core/smooth_noise.h"
#include "sim/effect.h"

namespace binrig::effects {

const Effect& speckle_noise() {
  static const Effect effect{
      {.name = "speckle_noise",
       .phenomenon = "Each scene has small depth errors of its own that stay as long as nothing moves.",
       .stage = Stage::geometry,
       .formula = "z' = z + s(u, v); s = white noise through a Gaussian of sigma correlation_length, scaled to "
                  "amplitude, drawn anew in each capture",
       .citation =
           "Dorsch, Haeusler and Herrmann, Laser triangulation: fundamental uncertainty in distance "
           "measurement, Applied Optics 33, 1994; of projected dots: our finding on Apple TrueDepth cameras, of "
           "which error maps are the more alike the nearer to each other two boards stand",
       .deviation =
           "as strong at any distance, where speckle through one lens would grow with its square (TrueDepth: as "
           "much from 0.18 to 0.25 m); a capture as a whole is one scene",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 20,
                       .typical_low = 0.02,
                       .typical_high = 0.5,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "standard deviation of the error"},
                      {.name = "correlation_length",
                       .unit = "px",
                       .lower = 0,
                       .upper = 8,
                       .typical_low = 1,
                       .typical_high = 5,
                       .initial = 2.5,
                       .meaning = "sigma of the Gaussian that smooths it: grain and matching window"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .per_capture_map = true,
       .revealed_by = "repeated frames of planes at several places: what stays in each and is another in all others"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        return adding(smooth_noise({context.camera.width, context.camera.height}, instance.value("correlation_length"),
                                   instance.value("amplitude"), context.capture_draws()));
      }};
  return effect;
}

}  // namespace binrig::effects
