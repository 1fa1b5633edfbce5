// Noise bumps: noise with a preferred size, from the spacing of the dots or the grid of matching windows: a ring in the
// spectrum.
//
//   z' = z + n,   power of n ~ exp(-(f - frequency)^2 / (2 width^2)) over the radius f, scaled to amplitude^2
#include <opencv2/core.hpp>

#include "core/spectrum.h"
#include "sim/effect.h"

namespace binrig::effects {
namespace {

NoiseSpectrum ring(const Camera& camera, double frequency, double width) {
  cv::Mat psd(camera.height, camera.width / 2 + 1, CV_64F);
  for (int j = 0; j < psd.rows; ++j) {
    for (int i = 0; i < psd.cols; ++i) {
      const double off = std::hypot(dft_frequency(i, camera.width), dft_frequency(j, camera.height)) - frequency;
      // The floor keeps a ring that falls between the samples of a small image from vanishing altogether.
      psd.at<double>(j, i) = std::exp(-off * off / (2 * width * width)) + 1e-12;
    }
  }
  psd.at<double>(0, 0) = 0;
  return NoiseSpectrum(psd, camera.width);
}

}  // namespace

const Effect& noise_bumps() {
  static const Effect effect{
      {.name = "noise_bumps",
       .phenomenon = "The noise has lumps of a preferred size.",
       .stage = Stage::noise,
       .formula = "z' = z + n with power ~ exp(-(f - frequency)^2 / (2 width^2)) over the radial frequency f, standard "
                  "deviation amplitude",
       .citation = "random-phase synthesis as in Sun, Rosin, Martin and Langbein, Noise analysis and synthesis for 3D "
                   "laser depth scanners, Graphical Models 71 (2009)",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 20,
                       .typical_low = 0.02,
                       .typical_high = 0.5,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "standard deviation of the added noise"},
                      {.name = "frequency",
                       .unit = "1/px",
                       .lower = 0.005,
                       .upper = 0.7,
                       .typical_low = 0.05,
                       .typical_high = 0.4,
                       .initial = 0.15,
                       .log_scaled = true,
                       .interpolate = false,
                       .meaning = "radius of the ring"},
                      {.name = "width",
                       .unit = "1/px",
                       .lower = 0.002,
                       .upper = 0.3,
                       .typical_low = 0.005,
                       .typical_high = 0.05,
                       .initial = 0.02,
                       .log_scaled = true,
                       .meaning = "standard deviation of the ring across its radius"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .revealed_by = "repeated frames of a plane: a ring in the spectrum"},
      [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
        const NoiseSynthesis synthesis(ring(context.camera, instance.value("frequency"), instance.value("width"))
                                           .scaled_to(1));
        return stateless([synthesis, amplitude_mm = instance.value("amplitude"), capture = &context](
                             Layers& layers, const Channels&, const FrameInstant& instant) {
          layers.noise_mm += amplitude_mm * synthesis.recent(capture->draws(instant.number));
        });
      }};
  return effect;
}

}  // namespace binrig::effects
