// binrig fit-noise: the noise of plane captures into a sensor model, and what it is worth on others.
#include <cstdio>
#include <filesystem>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "app/commands.h"
#include "app/model_files.h"
#include "app/noise_report.h"
#include "app/plane_captures.h"
#include "app/plane_simulation.h"
#include "calib/noise_fit.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/recording_writer.h"
#include "sim/effect.h"

namespace binrig {
namespace {

struct FitNoiseOptions {
  std::string measured, capture, model, out, report, noise = "auto";
  CommonOptions common;
};

PlaneSimulation plane_of(const PlaneCaptures& planes, const FirstLook& look, const FittedNoise& fit,
                         std::uint64_t seed) {
  PlaneSimulation s;
  s.camera = look.camera;
  s.normal = look.plane.normal;
  s.offset_mm = look.plane.offset_mm;
  s.projector_xyz_mm = planes.set.info().sensor.projector();
  const auto range = planes.set.info().sensor.range_mm;
  s.reference_distance_mm = range ? 0.5 * ((*range)[0] + (*range)[1]) : fit.anchor_mm;
  s.depth_scale_mm = look.depth_scale_mm;
  s.seed = seed;
  s.capture = look.key;
  return s;
}

// What the model makes of a capture's plane, through the capture's own mask and the same code.
CaptureNoise simulated_noise(const SensorModel& model, const PlaneCaptures& planes, const CaptureNoise& measured,
                             const FittedNoise& fit, std::uint64_t seed, int frames) {
  const FirstLook& real = measured.look;
  PlaneSimulation plane = plane_of(planes, real, fit, seed);
  const bool temporal = fit.temporal && measured.temporal;
  plane.frames = temporal ? frames : 1;
  const FrameStream stream = simulate_plane(model, plane, temporal ? 1 : frames);
  std::optional<FirstLook> look;
  const FrameStream first = simulate_plane(model, [&] {
    PlaneSimulation one = plane;
    one.frames = 1;
    return one;
  }());
  first([&](const Frame& frame, int) { look = look_at(real.key, real.name, frame, frames, real.plane.valid); });
  PlaneNoiseOptions options;
  options.max_lag_px = measured.single.max_lag_px;
  options.drop_order = measured.single.drop_order;
  options.single_frames = temporal ? 1 : frames;
  return measure_noise(*look, stream, false, options);
}

const CaptureNoise& nearest_to_anchor(const std::vector<CaptureNoise>& captures, const FittedNoise& fit) {
  const auto away = [&](const CaptureNoise& c) {
    return std::abs(std::log(c.look.plane.distance_mm / fit.anchor_mm)) / 0.05 +
           std::abs(c.look.plane.incidence_rad - fit.anchor_incidence_rad) / 0.1;
  };
  return *std::min_element(captures.begin(), captures.end(),
                           [&](const auto& a, const auto& b) { return away(a) < away(b); });
}

EffectInstance& instance_of(SensorModel& model, const std::string& effect) {
  for (auto& instance : model.effects)
    if (instance.effect == effect) return instance;
  return add_effect(model, effect_catalogue(), effect);
}

// Sets the amplitude effects that the model already has to the law that the captures follow, and returns the factor
// from sigma at the anchor to sigma where those effects are 1.
double apply_law(SensorModel& model, const FittedNoise& fit, double reference_mm, const std::string& provenance) {
  if (!fit.law.fitted) return 1;
  bool distance = false, incidence = false;
  for (auto& instance : model.effects) {
    if (instance.effect != "axial_noise" && instance.effect != "incidence_noise") continue;
    const bool axial = instance.effect == "axial_noise";
    const double value = axial ? fit.law.exponent : fit.law.incidence;
    const double se = axial ? fit.law.exponent_se : fit.law.incidence_se;
    const auto& declaration = instance.declaration(effect_catalogue());
    const ParameterSpec* spec = declaration.parameter(declaration.amplitude);
    if (spec == nullptr || value < spec->lower || value > spec->upper) continue;
    instance.values[spec->name] = {value, std::array{value - 1.96 * se, value + 1.96 * se}, provenance};
    (axial ? distance : incidence) = true;
  }
  const double there =
      fit.law.variance_at(distance ? reference_mm : fit.anchor_mm, incidence ? 0 : fit.anchor_incidence_term);
  return std::sqrt(there / fit.law.variance_at(fit.anchor_mm, fit.anchor_incidence_term));
}

// Effects after the noise (a blur, a filter) change it: the density that the model draws is corrected until what comes
// out at the end, storage included, is what was measured. What comes out is compared with what went in by the very same
// draws: their scatter, some 10 % at a single frequency, is in both and leaves the ratio. Divided by what came out
// alone, the density would take that scatter in, and be too large by its square.
struct Correction {
  int rounds = 0;
  double sigma_ratio = 1, spectrum_db = 0;  ///< what the model is expected to make against what was fitted, at the end
};

Correction correct_for_later_effects(SensorModel& model, EffectInstance& noise, NoiseSpectrum& spectrum,
                                     const std::string& spectrum_path, const std::string& provenance,
                                     const PlaneCaptures& planes, const CaptureNoise& anchor, const FittedNoise& fit,
                                     std::uint64_t seed) {
  const int n = fit.shape.natural_grid();
  const double level = fit.sigma_mm * fit.sigma_mm + fit.rounding_mm * fit.rounding_mm / 12;
  const double law = fit.law.fitted ? fit.law.variance_at(anchor.look.plane.distance_mm, anchor.look.incidence_term) /
                                          fit.law.variance_at(fit.anchor_mm, fit.anchor_incidence_term)
                                    : 1;
  // Only effects of the model can make the noise follow the law.
  bool follows = false;
  for (const auto& i : model.effects) follows |= i.effect == "axial_noise" || i.effect == "incidence_noise";
  const double wanted_level = level * (follows ? law : 1), floor = 1e-4 * wanted_level;
  const cv::Mat wanted = cv::max(fit.shape.density(n, n) * wanted_level, floor);
  Correction result;
  double before_db = 1e9;
  for (;; ++result.rounds) {
    spectrum.camera_width = anchor.look.camera.width;
    spectrum.camera_height = anchor.look.camera.height;
    spectrum.write(spectrum_path, provenance);
    noise.values["sigma"].value = std::sqrt(spectrum.variance_mm2());
    SensorModel alone = model;
    alone.effects = {noise};
    alone.depth_scale_from = Given::written;
    alone.depth_scale_mm = 0;  // not rounded
    const auto simulated = [&](const SensorModel& with) {
      const CaptureNoise made = simulated_noise(with, planes, anchor, fit, seed, fit.temporal ? 8 : 12);
      return fit.temporal ? *made.temporal : made.single;
    };
    const SpectrumEstimate in = simulated(alone), out = simulated(model);
    cv::Mat expected;
    cv::divide(cv::max(out.density(n, n), floor), cv::max(in.density(n, n), floor), expected);
    expected = cv::max(expected.mul(through_window(spectrum, fit.shape.window, n, n)), floor);
    const int rings = std::clamp(out.max_lag_px / 3, 4, 32);
    const NoiseSpectrum goal(wanted, n), come(expected, n);
    result.sigma_ratio = std::sqrt(come.variance_mm2() / goal.variance_mm2());
    const auto real = goal.radial(rings), made = come.radial(rings);
    double squares = 0;
    for (int r = 0; r < rings; ++r) squares += std::pow(10 * std::log10(made[r] / real[r]), 2) / rings;
    result.spectrum_db = std::sqrt(squares);
    const bool close = std::abs(result.sigma_ratio - 1) < 0.003 && result.spectrum_db < 0.02;
    const bool stuck = result.rounds >= 3 && result.spectrum_db > 0.8 * before_db;
    if (close || stuck || result.rounds == 9) return result;
    before_db = result.spectrum_db;
    cv::Mat ratio;
    cv::divide(wanted, expected, ratio);
    const cv::Mat psd = cv::max(spectrum.psd(), 1e-3 * floor).mul(cv::min(cv::max(ratio, 0.2), 5.0));
    spectrum = NoiseSpectrum(psd, spectrum.cols());
  }
}

// Temporal noise where it can be judged on held-out captures, too: they need repeats as well.
bool of_repeats(const std::string& wanted, const std::vector<CaptureNoise>& train,
                const std::vector<CaptureNoise>& test) {
  const auto repeats = [](const CaptureNoise& c) { return c.temporal.has_value(); };
  const bool possible = std::all_of(train.begin(), train.end(), repeats);
  if (wanted == "temporal" && !possible)
    throw Error("--noise temporal: not every train capture has more than one frame; fit one that has with --capture");
  if (wanted != "auto") return wanted == "temporal";
  return possible && (test.empty() || std::any_of(test.begin(), test.end(), repeats));
}

void run(const FitNoiseOptions& options) {
  apply(options.common);
  SensorModel model = read_sensor_model(options.model, effect_catalogue());
  if (model.dot_pattern)
    throw Error(options.model +
                " is a first-principles instrument: its noise follows from its parts and cannot be fitted");
  PlaneCaptures planes = open_plane_captures(options.measured, options.capture);

  NoiseFitReport report;
  report.set = options.measured;
  report.notes = planes.notes;
  std::vector<CaptureNoise> train, test;
  report.low = measure_plane_captures(planes, train, test);
  const FittedNoise fit = fit_noise(train, report.low, of_repeats(options.noise, train, test));

  const std::string provenance =
      fmt::format("fitted: {} {}, {} capture{}, {}", std::filesystem::path(options.measured).filename().string(),
                  options.capture.empty() ? "train" : options.capture, train.size(), train.size() == 1 ? "" : "s",
                  fit.temporal ? "temporal noise" : "single frames, an upper bound");
  rebase_files(model, options.out);
  const auto folder = std::filesystem::absolute(options.out).parent_path();
  std::filesystem::create_directories(folder);
  const std::string stem = std::filesystem::path(options.out).stem().string();
  const std::string spectrum_file = stem + ".spectrum.json", spectrum_path = (folder / spectrum_file).string();

  for (const auto& i : model.effects)
    if (i.effect == "depth_units" && i.value("step") > 1.5 * fit.rounding_mm)
      report.notes.push_back(
          fmt::format("the model rounds to {:.3g} mm ({}), the recording to {:.3g} mm: its rounding is noise "
                      "that no spectrum can take back",
                      i.value("step"), i.id, fit.rounding_mm));

  EffectInstance* noise = &instance_of(model, "spectral_noise");
  const auto range = planes.set.info().sensor.range_mm;
  const double reference = model.reference_from == Given::written ? model.reference_distance_mm
                           : range                                ? 0.5 * ((*range)[0] + (*range)[1])
                                                                  : fit.anchor_mm;
  const double to_reference = apply_law(model, fit, reference, provenance);
  noise->options["spectrum"] = spectrum_file;
  noise->provenance = provenance;
  noise->values["sigma"] = {fit.sigma_mm * to_reference, {}, provenance};
  noise->values["correlation_length"] = {std::clamp(fit.parametric.correlation_length_px, 0.0, 50.0),
                                         fit.parametric.correlation_length_ci95, provenance};
  noise->values["white_share"] = {fit.parametric.white_share, fit.parametric.white_share_ci95, provenance};
  NoiseSpectrum spectrum = fit.spectrum().scaled_to(fit.sigma_mm * to_reference);
  const CaptureNoise& anchor = nearest_to_anchor(train, fit);
  const Correction correction = correct_for_later_effects(model, *noise, spectrum, spectrum_path, provenance, planes,
                                                          anchor, fit, options.common.seed + 1000);
  // The interval is that of the noise as measured, carried over to the parameter.
  const double carried = noise->values["sigma"].value / fit.sigma_mm;
  noise->values["sigma"].ci95 = std::array{fit.sigma_ci95[0] * carried, fit.sigma_ci95[1] * carried};
  check_sensor_model(model, effect_catalogue());
  write_sensor_model(model, effect_catalogue(), options.out);

  // Held-out captures; where there are none, the anchor, marked as fitted to.
  const std::vector<CaptureNoise>& judged = test.empty() ? train : test;
  const CaptureNoise* counts = &nearest_to_anchor(judged, fit);
  report.judgements.resize(judged.size());
  Progress progress("simulating the judged captures", static_cast<std::int64_t>(judged.size()));
  parallel_for(static_cast<int>(judged.size()), [&](int i) {
    const CaptureNoise& measured = judged[static_cast<std::size_t>(i)];
    auto& judgement = report.judgements[static_cast<std::size_t>(i)];
    judgement = judge_noise(fit, measured, simulated_noise(model, planes, measured, fit, options.common.seed, 12));
    judgement.nearest = &measured == counts;
    progress.advance();
  });
  report.fit = fit;
  report.train = train;
  report.test = test;
  report.model_out = options.out;
  report.spectrum_file = spectrum_path;
  report.model_sigma_mm = noise->values["sigma"].value;
  report.correction_rounds = correction.rounds;
  report.correction_sigma_ratio = correction.sigma_ratio;
  report.correction_spectrum_db = correction.spectrum_db;

  const std::string json = noise_report_json(report).dump(1);
  write_file_atomically((folder / (stem + ".noise.json")).string(), json);
  if (!options.report.empty()) {
    std::filesystem::create_directories(options.report);
    write_file_atomically((std::filesystem::path(options.report) / "report.json").string(), json);
    report.page = write_noise_page(report, options.report);
  }
  if (options.common.json) {
    std::puts(json.c_str());
  } else {
    std::fputs(noise_report_text(report).c_str(), stdout);
  }
}

}  // namespace

void add_fit_noise(CLI::App& app, int& status) {
  auto options = std::make_shared<FitNoiseOptions>();
  CLI::App* verb =
      app.add_subcommand("fit-noise", "fits the noise spectrum to plane captures and judges it on held-out ones");
  verb->add_option("--measured", options->measured, "recording set")->required();
  verb->add_option("--capture", options->capture, "fit to this capture alone, e.g. train/1");
  verb->add_option("--model", options->model, "sensor model to start from")->required();
  verb->add_option("--out", options->out, "model to write; the spectrum goes to a file beside it")->required();
  verb->add_option(
          "--noise", options->noise,
          "temporal: what changes between frames; frame: all that is in one frame, an upper bound; auto: temporal "
          "where train and held-out captures repeat")
      ->check(CLI::IsMember({"auto", "temporal", "frame"}));
  verb->add_option("--report", options->report, "folder for report.html and report.json");
  add_common_options(*verb, options->common);
  verb->callback([options, &status] {
    run(*options);
    status = 0;
  });
}

}  // namespace binrig
