#include "app/plane_start.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "app/plane_captures.h"
#include "app/plane_simulation.h"
#include "compare/noise/quantisation.h"
#include "core/error.h"
#include "sim/effect.h"

namespace binrig {
namespace {

class PlaneStart {
 public:
  PlaneStart(SensorModel& model, PlaneCaptures planes, std::uint64_t seed,
             const std::function<bool(const std::string&, const std::string&)>& may_move)
      : model_(model), planes_(std::move(planes)), seed_(seed), may_move_(may_move) {
    std::vector<CaptureNoise> test;
    measure_plane_captures(planes_, train_, test);
    fit_ = fit_noise(train_, {}, std::all_of(train_.begin(), train_.end(), [](const CaptureNoise& c) {
                       return c.temporal.has_value();
                     }));
  }

  void run() {
    steps();
    noise();
  }

 private:
  EffectInstance* instance(const std::string& effect) {
    for (auto& i : model_.effects)
      if (i.effect == effect) return &i;
    return nullptr;
  }

  void set(EffectInstance& i, const std::string& parameter, double value) {
    const ParameterSpec* spec = i.declaration(effect_catalogue()).parameter(parameter);
    if (may_move_(i.id, parameter)) i.values[parameter].value = std::clamp(value, spec->lower, spec->upper);
  }

  void steps() {
    double step = 0, scale = 0, focal_baseline = 0;
    for (const CaptureNoise& c : train_) {
      step = step == 0 ? c.step_mm : std::min(step, c.step_mm);
      scale = c.look.depth_scale_mm;
      if (const auto projector = planes_.set.info().sensor.projector())
        focal_baseline = c.look.camera.fx * std::abs(projector->x());
    }
    EffectInstance* units = instance("depth_units");
    if (units != nullptr && step > 1.5 * scale) set(*units, "step", step);
    EffectInstance* disparity = instance("disparity_quantisation");
    if (disparity == nullptr || focal_baseline <= 0) return;
    std::vector<double> found;
    for (const CaptureNoise& c : train_) {
      ValueLevels values;
      const CaptureReader reader = planes_.set.capture(c.look.key);
      for (int i = 0; i < std::min(reader.size(), 4); ++i)
        values.add(reader.frame(i).depth_mm, c.look.plane.region, c.look.depth_scale_mm);
      const QuantisationStep q = values.finish();
      if (q.found && q.power == 2) found.push_back(focal_baseline * q.step_mm / (q.depth_mm * q.depth_mm));
    }
    if (found.empty()) return;
    std::sort(found.begin(), found.end());
    set(*disparity, "step", found[found.size() / 2]);
  }

  void noise() {
    EffectInstance* spectral = instance("spectral_noise");
    if (spectral == nullptr || !fit_.temporal) return;
    if (const auto file = spectral->options.find("spectrum"); file != spectral->options.end() && !file->second.empty())
      return;
    for (const char* parameter : {"sigma", "correlation_length", "white_share"})
      if (!may_move_(spectral->id, parameter)) return;
    const CaptureNoise& there = anchor();
    const double rounding = fit_.rounding_mm * fit_.rounding_mm / 12;
    // The shape over all captures at the level that the anchor's noise has, rounding taken out.
    SpectrumEstimate measured = fit_.shape;
    measured.covariance = fit_.shape.covariance * (fit_.sigma_mm * fit_.sigma_mm + rounding);
    measured.covariance.at<double>(measured.max_lag_px, measured.max_lag_px) -= rounding;
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
      if (!may_move_(i.id, spec->name) || (spec->neutral && value == *spec->neutral)) continue;
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
      if (!known.contains(key)) known = {{key, simulated(there, unfiltered(tried))}};
      const SpectrumEstimate out = simulated(there, tried), &in = known.at(key);
      const int n = out.natural_grid();
      cv::Mat passage;
      cv::divide(cv::max(out.density(n, n) - rounding, 0.0), cv::max(in.density(n, n), 1e-4 * in.variance_mm2()),
                 passage);
      return passage;
    };
    const FilteredNoise found =
        fit_through_filters(measured, filters, fit_.between_captures / std::sqrt(static_cast<double>(train_.size())));
    set(*spectral, "correlation_length", found.noise.correlation_length_px);
    set(*spectral, "white_share", found.noise.white_share);
    for (std::size_t k = 0; k < owners.size(); ++k)
      // At nothing a strength has no slope to be fitted by.
      set(*owners[k].first, owners[k].second->name, std::max(found.strength[k], owners[k].second->typical_low));
    // The level is that of all the power, also where the spectrum is of another form than the formula.
    set(*spectral, "sigma", found.noise.sigma_mm);
    const double passed = std::max(simulated(there, model_).variance_mm2() - rounding, 1e-12) /
                          simulated(there, unfiltered(model_)).variance_mm2();
    set(*spectral, "sigma", std::sqrt(measured.variance_mm2() / passed));
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

  /// The temporal noise that a model makes of a plane.
  SpectrumEstimate simulated(const CaptureNoise& c, const SensorModel& model) const {
    PlaneSimulation s;
    s.camera = c.look.camera;
    s.normal = c.look.plane.normal;
    s.offset_mm = c.look.plane.offset_mm;
    s.projector_xyz_mm = planes_.set.info().sensor.projector();
    const auto range = planes_.set.info().sensor.range_mm;
    s.reference_distance_mm = range ? 0.5 * ((*range)[0] + (*range)[1]) : fit_.anchor_mm;
    s.depth_scale_mm = c.look.depth_scale_mm;
    s.frames = 4;
    s.seed = seed_;
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

  SensorModel& model_;
  PlaneCaptures planes_;
  const std::uint64_t seed_;
  const std::function<bool(const std::string&, const std::string&)>& may_move_;
  std::vector<CaptureNoise> train_;
  FittedNoise fit_;
};

}  // namespace

void start_from_planes(SensorModel& model, const std::string& measured, std::uint64_t seed,
                       const std::function<bool(const std::string&, const std::string&)>& may_move) {
  const SetInfo info = RecordingSet::open(measured).info();
  if (std::none_of(info.captures.begin(), info.captures.end(), [](const CaptureInfo& c) {
        return c.split == "train" && c.target == TargetKind::plane && c.frames > 1;
      }))
    return;
  SensorModel moved = model;
  try {
    PlaneStart(moved, open_plane_captures(measured, ""), seed, may_move).run();
  } catch (const Error&) {
    return;  // no plane that can be measured: it begins where the user said
  }
  model = moved;
}

}  // namespace binrig
