// Wiggling: a time-of-flight sensor takes its modulation for a sine; the harmonics that it ignores make an error that
// is periodic in the distance.
//
//   z' = z + amplitude sin(4 pi z / wavelength + phase)
//
// z stands for the range: this is for narrow fields of view.
#include <numbers>

#include "core/image_math.h"
#include "sim/effect.h"

namespace binrig::effects {

const Effect& tof_wiggling() {
  static const Effect effect{{.name = "tof_wiggling",
                              .phenomenon = "A time-of-flight error that is periodic in the distance.",
                              .stage = Stage::geometry,
                              .formula = "z' = z + amplitude sin(4 pi z / wavelength + phase)",
                              .citation = "Lindner, Schiller, Kolb and Koch, Time-of-flight sensor calibration for "
                                          "accurate range sensing, CVIU 114 (2010)",
                              .deviation = "one sine instead of their splines; Z for the range",
                              .parameters = {{.name = "amplitude",
                                              .unit = "mm",
                                              .lower = 0,
                                              .upper = 50,
                                              .typical_low = 0.1,
                                              .typical_high = 3,
                                              .neutral = 0.0,
                                              .initial = 0.5,
                                              .meaning = "largest error"},
                                             {.name = "wavelength",
                                              .unit = "mm",
                                              .lower = 10,
                                              .upper = 100000,
                                              .typical_low = 50,
                                              .typical_high = 3000,
                                              .initial = 300,
                                              .log_scaled = true,
                                              .interpolate = false,
                                              .meaning = "modulation wavelength; the error repeats every half of it"},
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
                              .revealed_by = "planes at many distances, or one long tilted plane"},
                             [](const EffectInstance& instance, const CaptureContext&) {
                               const float a = static_cast<float>(instance.value("amplitude"));
                               const float turns_per_mm = static_cast<float>(2 / instance.value("wavelength"));
                               const float start = static_cast<float>(instance.value("phase") / (2 * std::numbers::pi));
                               return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
                                 map_depth(layers, [&](int) {
                                   return [=](float z, int) { return z + a * sin_turns(z * turns_per_mm + start); };
                                 });
                               });
                             }};
  return effect;
}

}  // namespace binrig::effects
