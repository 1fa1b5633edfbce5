// Thermal drift: after power-on the housing warms up and bends, so that projector and camera turn against each other;
// disparities drift and settle exponentially.
//
//   z' = f B / (d + amplitude exp(-t / time_constant)),   t = seconds since power-on
//
// In a capture that does not begin with power-on t is infinite: nothing drifts. A series much shorter than the time
// constant determines amplitude / time_constant alone.
#include "sim/effect.h"

namespace binrig::effects {

const Effect& thermal_drift() {
  static const Effect effect{
      {.name = "thermal_drift",
       .phenomenon = "Depth drifts for a while after power-on.",
       .stage = Stage::geometry,
       .formula = "z' = f B / (d + amplitude exp(-t / time_constant)), t since power-on",
       .citation = "first-order warming; warm-up seen in Chow, Ang, Lichti and Teskey, Performance analysis of a "
                   "low-cost triangulation-based 3D camera: Microsoft Kinect system, ISPRS Archives XXXIX-B (2012)",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "px",
                       .lower = -20,
                       .upper = 20,
                       .typical_low = 0.02,
                       .typical_high = 1,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.2,
                       .meaning = "disparity offset at power-on"},
                      {.name = "time_constant",
                       .unit = "s",
                       .lower = 0.1,
                       .upper = 20000,
                       .typical_low = 3,
                       .typical_high = 1200,
                       .initial = 60,
                       .log_scaled = true,
                       .meaning = "time after which 1/e of the drift is left"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .needs = {.baseline = true, .power_on = true},
       .revealed_by = "a series of a plane that begins with power-on"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double amplitude = instance.value("amplitude"), time_constant = instance.value("time_constant");
        const float fb = static_cast<float>(context.focal_baseline());
        return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
          const float shift = static_cast<float>(amplitude * std::exp(-instant.since_power_on_s / time_constant));
          if (shift == 0) return;
          map_depth(layers,
                    [&](int) { return [shift, fb](float z, int) { return with_disparity_added(z, shift, fb); }; });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
