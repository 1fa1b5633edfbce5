// binrig calibrate: the parameters that captures of planes determine, with intervals; the others are named.
#include <cstdio>
#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "app/commands.h"
#include "app/forward.h"
#include "app/plane_captures.h"
#include "app/plane_simulation.h"
#include "calib/noise_fit.h"
#include "calib/plane_bias.h"
#include "compare/noise/quantisation.h"
#include "core/error.h"
#include "core/recording_writer.h"
#include "sim/effect.h"

namespace binrig {
namespace {

struct CalibrateOptions {
  std::string measured, model, out;
  CommonOptions common;
};

struct Found {
  std::string instance, parameter, unit, how;
  double before = 0;
  ParameterValue value;
};

struct Open {
  std::string instance, parameter, reason;
};

class Calibration {
 public:
  Calibration(const CalibrateOptions& options)
      : options_(options),
        model_(read_sensor_model(options.model, effect_catalogue())),
        original_(model_),
        planes_(open_plane_captures(options.measured, "")) {
    if (model_.dot_pattern)
      throw Error(options.model + " is a first-principles instrument without effects to calibrate");
    provenance_ = "calibrated: planes of " + std::filesystem::path(options.measured).filename().string();
    measure_plane_captures(planes_, train_, test_);
    const auto repeats = [](const CaptureNoise& c) { return c.temporal.has_value(); };
    fit_ = fit_noise(train_, {}, std::all_of(train_.begin(), train_.end(), repeats));
  }

  void run() {
    steps();
    biases();
    noise();
    for (const EffectInstance& instance : model_.effects)
      for (const ParameterSpec& spec : instance.declaration(effect_catalogue()).parameters)
        if (!decided(instance.id, spec.name))
          open_.push_back({instance.id, spec.name, "captures of planes do not show it"});
    // Files named by the model are relative to it.
    for (auto& instance : model_.effects)
      for (auto& [name, value] : instance.options) {
        const OptionSpec* spec = instance.declaration(effect_catalogue()).option(name);
        if (spec == nullptr || !spec->is_file || value.empty() || std::filesystem::path(value).is_absolute()) continue;
        value = std::filesystem::proximate(std::filesystem::absolute(options_.model).parent_path() / value,
                                           std::filesystem::absolute(options_.out).parent_path())
                    .string();
      }
    model_.file = options_.out;
    std::filesystem::create_directories(std::filesystem::absolute(options_.out).parent_path());
    check_sensor_model(model_, effect_catalogue());
    write_sensor_model(model_, effect_catalogue(), options_.out);
    report();
  }

 private:
  EffectInstance* instance(const std::string& effect) {
    for (auto& i : model_.effects)
      if (i.effect == effect) return &i;
    return nullptr;
  }
  bool decided(const std::string& id, const std::string& parameter) const {
    for (const auto& f : found_)
      if (f.instance == id && f.parameter == parameter) return true;
    for (const auto& o : open_)
      if (o.instance == id && o.parameter == parameter) return true;
    return false;
  }
  // What the model said at first, before the search for the noise moved it.
  double before(const EffectInstance& i, const std::string& parameter) const {
    const EffectInstance* original = original_.find(i.id);
    return original == nullptr ? 0 : original->value(parameter);
  }
  void set(EffectInstance& i, const std::string& parameter, double value, std::array<double, 2> ci95,
           const std::string& how) {
    const ParameterSpec* spec = i.declaration(effect_catalogue()).parameter(parameter);
    const double inside = std::clamp(value, spec->lower, spec->upper);
    found_.push_back({i.id, parameter, spec->unit, how, before(i, parameter), {inside, ci95, provenance_}});
    i.values[parameter] = found_.back().value;
  }

  void steps() {
    double step = 0, scale = 0;
    double focal_baseline = 0;
    for (const CaptureNoise& c : train_) {
      step = step == 0 ? c.step_mm : std::min(step, c.step_mm);
      scale = c.look.depth_scale_mm;
      if (const auto projector = planes_.set.info().sensor.projector())
        focal_baseline = c.look.camera.fx * std::abs(projector->x());
    }
    if (EffectInstance* units = instance("depth_units")) {
      // A greatest common divisor is exact, or it is not one.
      if (step > 1.5 * scale)
        set(*units, "step", step, {step, step}, "every stored value is a multiple of it");
      else
        set(*units, "step", 0, {0, scale}, "values come in the file's own steps, nothing coarser");
    }
    EffectInstance* disparity = instance("disparity_quantisation");
    if (disparity == nullptr) return;
    if (focal_baseline <= 0) {
      open_.push_back({disparity->id, "step", "the projector's place is unknown"});
      return;
    }
    std::vector<double> found;
    for (const CaptureNoise& c : train_) {
      ValueLevels values;
      const CaptureReader reader = planes_.set.capture(c.look.key);
      for (int i = 0; i < std::min(reader.size(), 4); ++i)
        values.add(reader.frame(i).depth_mm, c.look.plane.region, c.look.depth_scale_mm);
      const QuantisationStep q = values.finish();
      if (q.found && q.power == 2) found.push_back(focal_baseline * q.step_mm / (q.depth_mm * q.depth_mm));
    }
    if (found.empty()) {
      open_.push_back(
          {disparity->id, "step", "no comb in disparity stands out of the values: finer than the noise, or none"});
      return;
    }
    std::sort(found.begin(), found.end());
    set(*disparity, "step", found[found.size() / 2], {found.front(), found.back()},
        fmt::format("comb in the values of {} captures; the interval is their range", found.size()));
  }

  void biases() {
    const std::map<std::string, std::pair<std::string, BiasTerm::Law>> laws{
        {"depth_offset", {"offset", BiasTerm::Law::offset}},
        {"depth_scale", {"scale", BiasTerm::Law::scale}},
        {"disparity_offset", {"offset", BiasTerm::Law::disparity}}};
    std::vector<BiasTerm> terms;
    std::vector<EffectInstance*> owners;
    for (auto& i : model_.effects) {
      const auto law = laws.find(i.effect);
      if (law == laws.end()) continue;
      const ParameterSpec* spec = i.declaration(effect_catalogue()).parameter(law->second.first);
      const auto projector = planes_.set.info().sensor.projector();
      const double fb = projector ? train_.front().look.camera.fx * std::abs(projector->x()) : 0;
      if (law->second.second == BiasTerm::Law::disparity && fb <= 0) {
        open_.push_back({i.id, spec->name, "the projector's place is unknown"});
        continue;
      }
      terms.push_back({i.id, spec->name, law->second.second, fb, spec->typical_high});
      owners.push_back(&i);
    }
    if (terms.empty()) return;
    const SetInfo& info = planes_.set.info();
    std::vector<PlaneBias> captures;
    if (!info.poses_fitted_to_this_depth && info.pose_sigma_mm) captures = known_planes();
    const auto values = fit_biases(captures, terms);
    for (std::size_t k = 0; k < terms.size(); ++k) {
      if (values[k].determined)
        set(*owners[k], terms[k].parameter, values[k].value, values[k].ci95,
            fmt::format("mean depth of {} planes against their poses", captures.size()));
      else
        open_.push_back({terms[k].instance, terms[k].parameter, values[k].reason});
    }
  }

  // Mean of measured minus nominal depth, for captures whose pose does not come from the depth itself.
  std::vector<PlaneBias> known_planes() {
    std::vector<std::string> keys;
    for (const CaptureNoise& c : train_) {
      const Frame header = planes_.set.capture(c.look.key).header(0);
      if (header.objects && !header.objects->empty()) keys.push_back(c.look.key);
    }
    if (keys.empty()) return {};
    ForwardOptions wanted;
    wanted.captures = keys;
    const Forward forward = open_forward_model(options_.measured, wanted);
    std::vector<PlaneBias> result;
    for (const CaptureNoise& c : train_) {
      for (std::size_t i = 0; i < forward.model->captures().size(); ++i) {
        if (forward.model->captures()[i].key() != c.look.key ||
            std::find(keys.begin(), keys.end(), c.look.key) == keys.end())
          continue;
        const auto channels =
            forward.model->perfect(static_cast<int>(i), 0, Offset{}, static_cast<ChannelSet>(Channel::depth), model_);
        const cv::Mat both = (channels->depth_mm > 0) & (c.look.plane.valid > 0);
        if (cv::countNonZero(both) < 400) continue;
        const Frame first = planes_.set.capture(c.look.key).frame(0);
        PlaneBias bias;
        bias.capture = c.look.key;
        bias.distance_mm = cv::mean(channels->depth_mm, both)[0];
        bias.bias_mm = cv::mean(first.depth_mm, both)[0] - bias.distance_mm;
        // A pose that is off along the normal moves depth by more on a slope; turning it about the target's middle
        // moves the mean little.
        const double sd = *planes_.set.info().pose_sigma_mm / std::cos(c.look.plane.incidence_rad);
        bias.sd_mm = std::hypot(sd, c.noise().sigma_mm() / std::sqrt(std::max(1.0, c.noise().effective_pixels())));
        result.push_back(bias);
      }
    }
    return result;
  }

  void noise() {
    EffectInstance* spectral = instance("spectral_noise");
    for (const char* effect : {"axial_noise", "incidence_noise"}) {
      EffectInstance* i = instance(effect);
      if (i == nullptr) continue;
      const bool axial = i->effect == "axial_noise";
      const double value = axial ? fit_.law.exponent : fit_.law.incidence;
      const double se = axial ? fit_.law.exponent_se : fit_.law.incidence_se;
      const std::string parameter = i->declaration(effect_catalogue()).amplitude;
      if (!fit_.law.fitted || se <= 0)
        open_.push_back({i->id, parameter,
                         axial ? "the planes are too few, or all at one distance"
                               : "the planes are too few, or all at one tilt, or the noise does not grow"});
      else
        set(*i, parameter, value, {value - 1.96 * se, value + 1.96 * se}, "standard deviations of the planes");
    }
    if (spectral == nullptr) return;
    const CaptureNoise& there = anchor();
    const double rounding = fit_.rounding_mm * fit_.rounding_mm / 12;
    // The shape over all captures at the level that the anchor's noise has by the law, rounding taken out.
    SpectrumEstimate measured = fit_.shape;
    const bool follows = instance("axial_noise") != nullptr || instance("incidence_noise") != nullptr;
    const double law = follows && fit_.law.fitted
                           ? fit_.law.variance_at(there.look.plane.distance_mm, there.look.incidence_term) /
                                 fit_.law.variance_at(fit_.anchor_mm, fit_.anchor_incidence_term)
                           : 1;
    measured.covariance = fit_.shape.covariance * ((fit_.sigma_mm * fit_.sigma_mm + rounding) * law);
    measured.covariance.at<double>(measured.max_lag_px, measured.max_lag_px) -= rounding;
    const std::string how = fmt::format(
        "{} of {} planes", fit_.temporal ? "temporal noise" : "single frames (an upper bound)", train_.size());
    // The fit's interval knows the spectrum's errors, the captures' that of the level. Where the spectrum is of another
    // form the former say nothing about the level.
    const auto wider = [&](double value, double low, double high) {
      const double level = 0.5 * std::log(fit_.sigma_ci95[1] / fit_.sigma_ci95[0]);
      return std::array{value * std::exp(-std::hypot(level, std::log(low))),
                        value * std::exp(std::hypot(level, std::log(high)))};
    };
    if (const auto file = spectral->options.find("spectrum");
        file != spectral->options.end() && !file->second.empty()) {
      double sigma = spectral->value("sigma");
      for (int round = 0; round < 3; ++round) {
        sigma *= std::sqrt(measured.variance_mm2() / std::max(simulated(model_).variance_mm2() - rounding, 1e-12));
        spectral->values["sigma"].value = sigma;
      }
      set(*spectral, "sigma", sigma, wider(sigma, 1, 1), how);
      for (const char* p : {"correlation_length", "white_share"})
        open_.push_back({spectral->id, p, "without effect: the model has a spectrum file"});
      return;
    }
    // What comes out of the model is what was measured: effects after the noise filter it.
    const auto unfiltered = [&](const SensorModel& model) {
      SensorModel alone = model;
      alone.effects = {*model.find(spectral->id)};
      alone.depth_scale_from = Given::written;
      alone.depth_scale_mm = 0;  // not rounded
      return alone;
    };
    NoiseFilters filters;
    std::vector<std::pair<EffectInstance*, const ParameterSpec*>> owners;
    for (auto& i : model_.effects) {
      const EffectDeclaration& declaration = i.declaration(effect_catalogue());
      const ParameterSpec* spec = declaration.parameter(declaration.amplitude);
      if (declaration.stage != Stage::spatial || spec == nullptr || spec->kind != ParameterKind::continuous) continue;
      const double value = i.value(spec->name);
      if (spec->neutral && value == *spec->neutral) {
        open_.push_back({i.id, spec->name, "it is switched off in the model"});
        continue;
      }
      filters.strengths.push_back({value, spec->lower, spec->upper, 0.25 * (spec->typical_high - spec->typical_low)});
      owners.emplace_back(&i, spec);
    }
    SensorModel tried = model_;
    std::map<std::string, SpectrumEstimate> known;  // what goes in, by the noise's parameters
    filters.passage = [&](const ParametricNoise& noise, const std::vector<double>& strengths) {
      EffectInstance& drawn = *std::find_if(tried.effects.begin(), tried.effects.end(),
                                            [&](const EffectInstance& i) { return i.id == spectral->id; });
      drawn.values["sigma"].value = noise.sigma_mm;
      drawn.values["correlation_length"].value = std::clamp(noise.correlation_length_px, 0.0, 50.0);
      // What a filter lets through is only seen where something goes in.
      drawn.values["white_share"].value = std::max(0.3, noise.white_share);
      for (std::size_t k = 0; k < owners.size(); ++k)
        for (auto& i : tried.effects)
          if (i.id == owners[k].first->id) i.values[owners[k].second->name].value = strengths[k];
      const std::string key = fmt::format("{} {} {}", noise.sigma_mm, noise.correlation_length_px, noise.white_share);
      if (!known.contains(key)) {
        known = {{key, simulated(unfiltered(tried))}};
      }
      const SpectrumEstimate out = simulated(tried), &in = known.at(key);
      const int n = out.natural_grid();
      const double floor = 1e-4 * in.variance_mm2();
      cv::Mat passage;
      cv::divide(cv::max(out.density(n, n) - rounding, 0.0), cv::max(in.density(n, n), floor), passage);
      return passage;
    };
    const FilteredNoise found =
        fit_through_filters(measured, filters, fit_.between_captures / std::sqrt(static_cast<double>(train_.size())));
    spectral->values["correlation_length"].value = std::clamp(found.noise.correlation_length_px, 0.0, 50.0);
    spectral->values["white_share"].value = found.noise.white_share;
    for (std::size_t k = 0; k < owners.size(); ++k)
      owners[k].first->values[owners[k].second->name].value = found.strength[k];
    // The level is that of all the power, also where the spectrum is of another form than the formula.
    spectral->values["sigma"].value = found.noise.sigma_mm;
    const double passed =
        std::max(simulated(model_).variance_mm2() - rounding, 1e-12) / simulated(unfiltered(model_)).variance_mm2();
    const double sigma = std::sqrt(measured.variance_mm2() / passed);
    const bool formed = found.noise.misfit <= 4;
    set(*spectral, "sigma", sigma,
        formed ? wider(sigma, found.noise.sigma_ci95[0] / found.noise.sigma_mm,
                       found.noise.sigma_ci95[1] / found.noise.sigma_mm)
               : wider(sigma, 1, 1),
        how);
    set(*spectral, "correlation_length", found.noise.correlation_length_px, found.noise.correlation_length_ci95, how);
    set(*spectral, "white_share", found.noise.white_share, found.noise.white_share_ci95, how);
    for (std::size_t k = 0; k < owners.size(); ++k) {
      const auto& [i, spec] = owners[k];
      if (found.determined[k])
        set(*i, spec->name, found.strength[k], found.strength_ci95[k], "its trace in the noise's spectrum");
      else
        open_.push_back(
            {i->id, spec->name,
             fmt::format("the noise's spectrum says hardly anything about it; {:.3g} {} goes with the noise "
                         "above",
                         found.strength[k], spec->unit)});
    }
    if (!formed)
      remarks_.push_back(
          fmt::format("the noise's spectrum is not of the parametric form (misfit {:.0f}; 1 = chance): "
                      "fit-noise fits it freely",
                      found.noise.misfit));
  }

  const CaptureNoise& anchor() const {
    return *std::min_element(train_.begin(), train_.end(), [&](const CaptureNoise& a, const CaptureNoise& b) {
      const auto away = [&](const CaptureNoise& c) {
        return std::abs(std::log(c.look.plane.distance_mm / fit_.anchor_mm)) / 0.05 +
               std::abs(c.look.plane.incidence_rad - fit_.anchor_incidence_rad) / 0.1;
      };
      return away(a) < away(b);
    });
  }

  // The temporal noise that a model makes of the anchor's plane.
  SpectrumEstimate simulated(const SensorModel& model) const {
    const CaptureNoise& c = anchor();
    PlaneSimulation s;
    s.camera = c.look.camera;
    s.normal = c.look.plane.normal;
    s.offset_mm = c.look.plane.offset_mm;
    s.projector_xyz_mm = planes_.set.info().sensor.projector();
    const auto range = planes_.set.info().sensor.range_mm;
    s.reference_distance_mm = range ? 0.5 * ((*range)[0] + (*range)[1]) : fit_.anchor_mm;
    s.depth_scale_mm = c.look.depth_scale_mm;
    s.frames = 4;
    s.seed = options_.common.seed;
    s.capture = c.look.key;
    // The plane is known. What goes into a filter may be much noisier than what was measured: no outlier.
    FirstLook look = c.look;
    look.frames = s.frames;
    look.plane.sigma_mm *= 5;
    PlaneNoiseOptions options;
    options.max_lag_px = c.single.max_lag_px;
    options.drop_order = options.single_frames = 1;  // what repeats show is all that is asked
    return *measure_noise(look, simulate_plane(model, s), false, options).temporal;
  }

  void report() const {
    nlohmann::json json{
        {"model", options_.out}, {"measured", options_.measured}, {"notes", planes_.notes}, {"remarks", remarks_}};
    json["parameters"] = nlohmann::json::array();
    json["not_determined"] = nlohmann::json::array();
    for (const auto& f : found_)
      json["parameters"].push_back({{"instance", f.instance},
                                    {"parameter", f.parameter},
                                    {"unit", f.unit},
                                    {"before", f.before},
                                    {"value", f.value.value},
                                    {"ci95", *f.value.ci95},
                                    {"how", f.how}});
    for (const auto& o : open_)
      json["not_determined"].push_back({{"instance", o.instance}, {"parameter", o.parameter}, {"reason", o.reason}});
    const std::filesystem::path out = std::filesystem::absolute(options_.out);
    write_file_atomically((out.parent_path() / (out.stem().string() + ".calibration.json")).string(), json.dump(1));
    if (options_.common.json) {
      std::puts(json.dump(1).c_str());
      return;
    }
    fmt::print("{:<24}{:<20}{:>10} {:>10}  {:<26}\n", "effect", "parameter", "before", "fitted", "95 % interval");
    for (const auto& f : found_)
      fmt::print("{:<24}{:<20}{:>10.4g} {:>10.4g}  [{:.4g}, {:.4g}] {}   {}\n", f.instance, f.parameter, f.before,
                 f.value.value, (*f.value.ci95)[0], (*f.value.ci95)[1], f.unit, f.how);
    if (!open_.empty()) fmt::print("\nNot determined by this recording's planes:\n");
    for (const auto& o : open_) fmt::print("  {}.{}: {}\n", o.instance, o.parameter, o.reason);
    for (const auto& r : remarks_) fmt::print("note: {}\n", r);
    for (const auto& n : planes_.notes) fmt::print("{}\n", n);
    fmt::print("\nmodel: {}\n", options_.out);
  }

  CalibrateOptions options_;
  SensorModel model_, original_;
  PlaneCaptures planes_;
  std::vector<CaptureNoise> train_, test_;
  FittedNoise fit_;
  std::string provenance_;
  std::vector<Found> found_;
  std::vector<Open> open_;
  std::vector<std::string> remarks_;
};

}  // namespace

void add_calibrate(CLI::App& app, int& status) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* verb = app.add_subcommand(
      "calibrate", "fits the parameters of a model's effects that captures of planes determine, with intervals");
  verb->add_option("--measured", options->measured, "recording set")->required();
  verb->add_option("--model", options->model, "sensor model to start from")->required();
  verb->add_option("--out", options->out, "model to write")->required();
  add_common_options(*verb, options->common);
  verb->callback([options, &status] {
    apply(options->common);
    Calibration(*options).run();
    status = 0;
  });
}

}  // namespace binrig
