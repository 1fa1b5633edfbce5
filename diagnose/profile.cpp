#include "diagnose/profile.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/parallel.h"
#include "diagnose/mean_of_simulations.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double chi_95 = 3.84;
constexpr int seeds = 4;  // two are rougher than what is left of most recordings

}  // namespace

Profile::Profile(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                 const Metric& metric, const std::vector<double>& place, bool targets_go_along, std::uint64_t seed)
    : experiment_(experiment),
      motions_(motions),
      rung_(rung),
      metric_(metric),
      place_(place),
      targets_go_along_(targets_go_along),
      seed_(seed),
      fold_metrics_(rung.others.size()) {
  const Layout& layout = experiment.layout();
  parallel_for(static_cast<int>(fold_metrics_.size()), [&](int fold) {
    fold_metrics_[fold] = Metric(layout, Part::train, motion_rows(layout, rung.others[fold], motions));
  });
}

double Profile::ask(double value, const SensorModel& model) {
  if (const auto known = tried_.find(value); known != tried_.end()) return known->second.chi;
  FitOptions options;
  options.seeds = seeds;
  options.seed = seed_;
  options.place = place_;
  if (targets_go_along_) options.motions = &motions_;
  const Fit fit = fit_model(experiment_, rung_.standard, metric_, rung_.data, model, {}, rung_.offsets, options);

  // The simulations of the rung stand about its places: where the targets went counts from there.
  std::vector<double> moved = fit.place;
  for (std::size_t m = 0; m < moved.size(); ++m) moved[m] -= place_[m];
  Tried tried{fit.chi, std::vector<double>(rung_.nulls.size())};
  const int folds = static_cast<int>(fold_metrics_.size());
  parallel_for(folds, [&](int fold) {
    const MeanOfSimulations mean = mean_of(rung_.others[fold], fit.simulations);
    for (std::size_t k = fold; k < rung_.nulls.size(); k += folds) {
      Whitened difference = rung_.nulls[k];
      for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= mean.mean[i];
      tried.nulls[k] = fold_metrics_[fold].explain(difference, moved, {}, mean.noise).chi;
    }
  });
  if (tried_.empty()) at_nulls_ = value;
  return tried_.emplace(value, std::move(tried)).first->second.chi;
}

double Profile::best() const {
  return std::min_element(tried_.begin(), tried_.end(),
                          [](const auto& a, const auto& b) { return a.second.chi < b.second.chi; })
      ->first;
}

double Profile::limit() const {
  std::vector<double> rises;
  for (std::size_t k = 0; k < rung_.nulls.size(); ++k) {
    double least = tried_.at(at_nulls_).nulls[k];
    for (const auto& [value, tried] : tried_) least = std::min(least, tried.nulls[k]);
    rises.push_back(tried_.at(at_nulls_).nulls[k] - least);
  }
  double rise = 0;
  if (!rises.empty()) {
    // The 95th percentile of a new draw from the same distribution: rank 0.95 (n + 1), between neighbours.
    std::sort(rises.begin(), rises.end());
    const double last = static_cast<double>(rises.size() - 1);
    const double rank = std::clamp(0.95 * (last + 2) - 1, 0.0, last);
    const auto below = static_cast<std::size_t>(rank), above = std::min(below + 1, rises.size() - 1);
    rise = rises[below] + (rank - static_cast<double>(below)) * (rises[above] - rises[below]);
  }
  return std::max(chi_95, rise) * rung_.dispersion;
}

std::pair<double, double> Profile::interval(double lower, double upper) const {
  const double highest = tried_.at(best()).chi + limit();
  const auto holds = [&](const auto& entry) { return entry.second.chi <= highest; };
  const auto first = std::find_if(tried_.begin(), tried_.end(), holds);
  const auto beyond = std::find_if(tried_.rbegin(), tried_.rend(), holds).base();
  return {first == tried_.begin() ? lower : std::prev(first)->first, beyond == tried_.end() ? upper : beyond->first};
}

void explore(Profile& profile, const SensorModel& model, const std::string& id, const ParameterSpec& spec, double unit,
             const std::vector<double>& reaches, const Follow& follow) {
  constexpr int most_moves = 4, most_doublings = 6;
  const bool logarithmic = spec.log_scaled && spec.kind != ParameterKind::integer;
  const auto ask = [&](double from, double reach) {
    double at = logarithmic && from > 0 ? from * std::exp(reach * unit) : from + reach * unit;
    at = std::clamp(spec.kind == ParameterKind::integer ? std::round(at) : at, spec.lower, spec.upper);
    SensorModel changed = model;
    value_in(changed, id, spec.name).value = at;
    const double chi = profile.ask(at, follow ? follow(changed) : changed);
    if (tracing()) fmt::print(stderr, "{}.{} = {:.5g}: chi {:.1f}\n", id, spec.name, at, chi);
    return at;
  };
  double middle = ask(model.find(id)->value(spec.name), 0);
  for (int moves = 0; moves < most_moves; ++moves) {
    for (const double reach : reaches) ask(middle, reach), ask(middle, -reach);
    if (profile.best() == middle) break;
    middle = profile.best();
  }
  double reach = reaches.back();
  for (int k = 0; k < most_doublings && (profile.open_below() || profile.open_above()); ++k) {
    const bool below = profile.open_below(), above = profile.open_above();
    if (below && above && k == 2) {
      for (const double far : {spec.typical_low, spec.typical_high}) ask(far, 0);
      break;
    }
    reach *= 2;
    if (below) ask(middle, -reach);
    if (above) ask(middle, reach);
  }
}

void explore_steps(Profile& profile, const SensorModel& model, const std::string& id, const ParameterSpec& spec,
                   const Follow& follow) {
  const double scale = std::abs(spec.typical_high - spec.typical_low);
  if (spec.kind == ParameterKind::integer)
    explore(profile, model, id, spec, 1, {1}, follow);
  else
    explore(profile, model, id, spec, spec.log_scaled ? 0.004 : 0.004 * scale, {1, 4, 15}, follow);
}

std::optional<std::array<double, 2>> certain(const Profile& profile, const ParameterSpec& spec) {
  if (profile.open_below() && profile.open_above()) return std::nullopt;
  auto [low, high] = profile.interval(spec.lower, spec.upper);
  if (spec.kind == ParameterKind::integer) {
    low = std::min(low + (profile.open_below() ? 0 : 1), profile.best());
    high = std::max(high - (profile.open_above() ? 0 : 1), profile.best());
  }
  if (tracing())
    fmt::print(stderr, "{}: {:.5g} ({:.5g} .. {:.5g}), chi may rise by {:.1f}\n", spec.name, profile.best(), low, high,
               profile.limit());
  return {{low, high}};
}

}  // namespace binrig
