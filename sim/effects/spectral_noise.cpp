// spectral_noise: correlated Gaussian noise with a measured or a parametric power spectrum.
//
// Phenomenon: the depth noise of a matching sensor is not white. Neighbouring pixels share most of their matching
// window or filter support, so that the noise has a power spectrum S(fx, fy) that falls with frequency.
//
// Model, per frame: n(u, v) = inverse DFT of sqrt(S) with a random phase at every frequency; scaled by the sigma_scale
// layer and added to the noise layer.
//   S from a file (NoiseSpectrum, what `binrig fit-noise` writes), scaled to sigma, or
//   S = sigma^2 ((1 - w) g(f) + w), g = exp(-(2 pi L f)^2) scaled to mean 1 over all frequencies, f in cycles per px.
//   | sigma              | mm | standard deviation where sigma_scale is 1; it scales a file, too |
//   | correlation_length | px | L; without effect where a file is given |
//   | white_share        | 1  | w, the share of the variance that is white; 1 = independent Gaussian pixels |
//
// Source: X. Sun, P. L. Rosin, R. R. Martin, F. C. Langbein, "Noise analysis and synthesis for 3D laser depth
// scanners", Graphical Models 71 (2009) 34-48: residual of a plane, DFT magnitude, random phase, inverse DFT. We
// deviate: the magnitude comes from an averaged, mask-corrected spectrum instead of one frame's periodogram (a single
// periodogram's scatter would be frozen into every frame), and unless `magnitudes: fixed` is asked for, the magnitudes
// are drawn, too, which makes an exact Gaussian field whose power scatters in every frequency, the mean included, as a
// real frame's does; fixed magnitudes give every frame the same variance to the last digit. A spectrum that was sampled on another image size is averaged onto
// this camera's grid: frequencies are per pixel, so the correlation keeps its length in pixels.
//
// Not for: noise whose strength changes over the image (put an amplitude effect before it), static patterns
// (fixed_pattern_noise), row or column noise (their ridges have effects of their own). The field is periodic in the
// image: opposite borders are correlated over the correlation length. Whole frames move by hardly anything (vibration
// does that).
#include <filesystem>
#include <memory>
#include <string>

#include "core/error.h"
#include "core/recently_made.h"
#include "core/spectrum.h"
#include "sim/effect.h"

namespace binrig::effects {

namespace {

EffectDeclaration declare() {
  EffectDeclaration d;
  d.name = "spectral_noise";
  d.phenomenon = "Depth noise that neighbouring pixels share, with the power spectrum of the real sensor.";
  d.stage = Stage::noise;
  d.formula =
      "z + sigma_scale * n, n = inverse DFT of sqrt(S) with random phases; S from a file scaled to sigma, or "
      "sigma^2 ((1 - white_share) g + white_share), g = exp(-(2 pi correlation_length f)^2) scaled to mean 1";
  d.citation =
      "Sun, Rosin, Martin, Langbein: Noise analysis and synthesis for 3D laser depth scanners, Graphical Models 71 "
      "(2009)";
  d.deviation = "the magnitude is an averaged, mask-corrected spectrum, not one frame's periodogram";
  d.parameters = {
      {.name = "sigma",
       .unit = "mm",
       .lower = 0,
       .upper = 100,
       .typical_low = 0.05,
       .typical_high = 2,
       .neutral = 0.0,
       .initial = 0.2,
       .log_scaled = true,
       .meaning = "standard deviation of the noise where nothing scales it; scales a spectrum file, too"},
      {.name = "correlation_length",
       .unit = "px",
       .lower = 0,
       .upper = 50,
       .typical_low = 0.3,
       .typical_high = 5,
       .neutral = {},
       .initial = 0.8,
       .meaning = "L of the parametric spectrum; without effect where a spectrum file is given"},
      {.name = "white_share",
       .unit = "1",
       .lower = 0,
       .upper = 1,
       .typical_low = 0.02,
       .typical_high = 0.5,
       .neutral = {},
       .initial = 0.1,
       .meaning = "share of the variance that is white; without effect where a spectrum file is given"},
  };
  d.options = {
      {.name = "spectrum",
       .meaning = "file with a fitted spectrum (binrig fit-noise writes it); absent = the parametric spectrum",
       .default_value = "",
       .choices = {},
       .is_file = true},
      {.name = "magnitudes",
       .meaning = "rayleigh: drawn magnitudes, an exact Gaussian field; fixed: the same magnitudes in every frame",
       .default_value = "rayleigh",
       .choices = {"rayleigh", "fixed"}},
  };
  d.neighbourhood_px = -1;
  d.amplitude = "sigma";
  d.revealed_by = "a plane, several frames";
  return d;
}

// Everything that a synthesis depends on, as text. All are made with a standard deviation of 1 mm, so that sigma is none
// of it.
std::string synthesis_key(const EffectInstance& instance, const std::string& file, const Camera& camera,
                          bool rayleigh) {
  std::string key = std::to_string(camera.height) + "x" + std::to_string(camera.width) + (rayleigh ? "r" : "f");
  if (file.empty()) {
    return key + " " + number_text(instance.value("correlation_length")) + " " +
           number_text(instance.value("white_share"));
  }
  std::error_code ignored;
  const auto changed = std::filesystem::last_write_time(file, ignored).time_since_epoch().count();
  return key + " " + file + " " + std::to_string(changed) + " " +
         std::to_string(std::filesystem::file_size(file, ignored));
}

std::shared_ptr<const NoiseSynthesis> make_synthesis(const EffectInstance& instance, const std::string& file,
                                                     const Camera& camera, bool rayleigh) {
  if (file.empty()) {
    return std::make_shared<NoiseSynthesis>(
        NoiseSpectrum::parametric(camera.height, camera.width, 1, instance.value("correlation_length"),
                                  instance.value("white_share")),
        rayleigh);
  }
  try {
    const NoiseSpectrum spectrum = NoiseSpectrum::read(file);
    if (spectrum.camera_width > 0 &&
        (spectrum.camera_width != camera.width || spectrum.camera_height != camera.height)) {
      throw Error("was measured on a camera of " + std::to_string(spectrum.camera_width) + " x " +
                  std::to_string(spectrum.camera_height) + " px, not " + std::to_string(camera.width) + " x " +
                  std::to_string(camera.height) + ": fit the noise of this camera, or use the parametric spectrum");
    }
    return std::make_shared<NoiseSynthesis>(spectrum.resampled(camera.height, camera.width).scaled_to(1), rayleigh);
  } catch (const Error& error) {
    throw Error("spectral_noise", {{.where = instance.where,
                                    .key = instance.id + ".spectrum",
                                    .value = file,
                                    .unit = {},
                                    .bounds = {},
                                    .message = error.what()}});
  }
}

// Simulating many captures with one model must not read the file and fill the spectrum anew each time.
std::shared_ptr<const NoiseSynthesis> shared_synthesis(const EffectInstance& instance, const CaptureContext& context) {
  const auto option = [&](const std::string& name) {
    const auto found = instance.options.find(name);
    return found == instance.options.end() ? std::string() : found->second;
  };
  std::string file = option("spectrum");
  if (!file.empty() && std::filesystem::path(file).is_relative())
    file = (std::filesystem::path(context.model_folder) / file).string();
  const bool rayleigh = option("magnitudes") != "fixed";
  const std::string key = synthesis_key(instance, file, context.camera, rayleigh);

  static RecentlyMade<std::string, std::shared_ptr<const NoiseSynthesis>> recent(8);
  return recent.get(key, [&] { return make_synthesis(instance, file, context.camera, rayleigh); });
}

class SpectralNoiseRun : public Run {
 public:
  SpectralNoiseRun(double sigma_mm, std::shared_ptr<const NoiseSynthesis> synthesis, const CaptureContext& context)
      : sigma_mm_(static_cast<float>(sigma_mm)), synthesis_(std::move(synthesis)), context_(context) {}

  void apply(Layers& layers, const Channels&, const FrameInstant& instant) override {
    const cv::Mat unit = synthesis_->recent(context_.draws(instant.number));
    for_rows(unit.size(), [&](int first, int last) {
      for (int row = first; row < last; ++row) {
        const float* field = unit.ptr<float>(row);
        const float* scale = layers.sigma_scale.ptr<float>(row);
        float* noise = layers.noise_mm.ptr<float>(row);
        for (int col = 0; col < unit.cols; ++col) noise[col] += sigma_mm_ * field[col] * scale[col];
      }
    });
  }

 private:
  float sigma_mm_;
  std::shared_ptr<const NoiseSynthesis> synthesis_;
  const CaptureContext& context_;
};

}  // namespace

const Effect& spectral_noise() {
  static const Effect effect{
      declare(), [](const EffectInstance& instance, const CaptureContext& context) {
        return std::unique_ptr<Run>(std::make_unique<SpectralNoiseRun>(
            instance.value("sigma"), shared_synthesis(instance, context), context));
      }};
  return effect;
}

}  // namespace binrig::effects
