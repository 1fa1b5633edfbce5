#include "diagnose/slope_simulation.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "diagnose/slopes.h"

namespace binrig {
namespace {

constexpr double least_signal = 0.5;  // a segment of a derivative that is more than half noise is left out

bool draws_map(const SensorModel& model, const EffectCatalogue& catalogue, const std::string& id) {
  const EffectInstance* instance = model.find(id);
  return instance && instance->declaration(catalogue).per_unit_map;
}

std::vector<Whitened> differences_of(const Standard& standard, const std::vector<StatVector>& changes) {
  std::vector<Whitened> result;
  for (const StatVector& one : changes) result.push_back(standard.difference(one));
  return result;
}

/// Copies what captures say that were not simulated.
void stay_elsewhere(const Layout& layout, StatVector& result, const StatVector& as_it_is,
                    const std::vector<int>& simulated) {
  for (const Block& block : layout.blocks)
    if (std::find(simulated.begin(), simulated.end(), block.capture) == simulated.end())
      std::copy_n(as_it_is.begin() + block.offset, block.size, result.begin() + block.offset);
}

void forget_bias(const Layout& layout, Whitened& change) {
  for (const Block& block : layout.blocks)
    if (segments()[block.segment].name == "bias") std::fill_n(change.begin() + block.offset, block.size, 0.f);
}

}  // namespace

double SlopeSimulation::touched_share(int p) const {
  if (p >= static_cast<int>(touched_.size()) || !touched_[p]) return 1;
  return static_cast<double>(touched_[p]->captures.size()) / experiment_.layout().captures;
}

/// Where a derivative is taken to: inwards of the bounds.
double SlopeSimulation::derivative_step(int p) const {
  const FitParameter& parameter = parameters_[p];
  const double ahead = parameter.natural(now_.value[p] + parameter.step);
  const bool outside = !parameter.circular && std::abs(parameter.scaled(ahead) - now_.value[p]) < 0.5 * parameter.step;
  return outside ? -parameter.step : parameter.step;
}

/// Simulations of all seeds with one parameter a step ahead, by parameter. Many parameters move nothing in most
/// captures (a threshold for highlights on planes): where the first seed shows no change, no other is simulated, and
/// none later while the parameter stays near.
std::vector<std::vector<StatVector>> SlopeSimulation::simulate_ahead(const std::vector<int>& moved) {
  touched_.resize(parameters_.size());
  std::vector<std::vector<StatVector>> ahead(parameters_.size());
  const auto simulate = [&](bool asked_before, int seeds) {
    std::vector<Trial> trials;
    std::vector<std::pair<int, int>> of;  // parameter, seed
    for (const int p : moved) {
      if (touched_[p].has_value() != asked_before || (asked_before && touched_[p]->captures.empty())) continue;
      Eigen::VectorXd x = now_.value;
      x[p] += derivative_step(p);
      for (int k = static_cast<int>(ahead[p].size()); k < seeds; ++k) {
        trials.push_back(trial_of(options_, with_values(now_.model, parameters_, x), now_.offsets, k));
        if (asked_before) trials.back().only = touched_[p]->captures;
        of.emplace_back(p, k);
      }
    }
    auto results = experiment_.simulate(trials, "fitting parameters");
    for (std::size_t t = 0; t < trials.size(); ++t) {
      const auto [p, k] = of[t];
      if (asked_before) stay_elsewhere(experiment_.layout(), results[t], now_.simulations[k], trials[t].only);
      ahead[p].push_back(std::move(results[t]));
    }
  };
  for (const int p : moved)
    if (touched_[p] && std::abs(touched_[p]->value - now_.value[p]) > parameters_[p].longest) touched_[p].reset();
  simulate(false, 1);
  for (const int p : moved)
    if (!touched_[p])
      touched_[p] =
          Touched{now_.value[p], captures_that_differ(experiment_.layout(), ahead[p][0], now_.simulations[0])};
  simulate(true, options_.seeds);
  for (const int p : moved)
    for (int k = static_cast<int>(ahead[p].size()); k < options_.seeds; ++k) ahead[p].push_back(now_.simulations[k]);
  return ahead;
}

/// The same a step behind, of parameters that make up for each other to first order (a period and its phase): from one
/// side they would seem to differ by the second. Empty for all others.
std::vector<std::vector<StatVector>> SlopeSimulation::simulate_behind(const std::vector<int>& moved) const {
  std::vector<std::vector<StatVector>> behind(parameters_.size());
  std::vector<Trial> trials;
  std::vector<std::pair<int, int>> of;  // parameter, seed
  for (const int p : moved) {
    if (!parameters_[p].narrow && !parameters_[p].circular) continue;
    behind[p] = now_.simulations;
    if (touched_[p]->captures.empty()) continue;
    Eigen::VectorXd x = now_.value;
    x[p] -= derivative_step(p);
    for (int k = 0; k < options_.seeds; ++k) {
      trials.push_back(trial_of(options_, with_values(now_.model, parameters_, x), now_.offsets, k));
      trials.back().only = touched_[p]->captures;
      of.emplace_back(p, k);
    }
  }
  auto results = experiment_.simulate(trials, "fitting parameters");
  for (std::size_t t = 0; t < trials.size(); ++t) {
    const auto [p, k] = of[t];
    stay_elsewhere(experiment_.layout(), results[t], now_.simulations[k], trials[t].only);
    behind[p][k] = std::move(results[t]);
  }
  return behind;
}

void SlopeSimulation::run() {
  fit_.slopes.resize(parameters_.size(), Whitened(experiment_.layout().size, 0.f));
  fit_.seed_slopes.resize(parameters_.size());
  std::vector<int> moved;
  for (int p = 0; p < static_cast<int>(parameters_.size()); ++p)
    if (!fit_.paused[p]) moved.push_back(p);
  while (!moved.empty()) {
    run_of(moved);
    // What pixels toss for drowns in the tosses of a small step: these grow by its root.
    std::erase_if(moved, [&](int p) {
      const auto& slope = fit_.slopes[p];
      return touched_[p]->captures.empty() || parameters_[p].step >= parameters_[p].longest ||
             std::any_of(slope.begin(), slope.end(), [](float v) { return v != 0; });
    });
    for (const int p : moved) {
      parameters_[p].step = parameters_[p].longest;
      touched_[p].reset();
    }
  }
}

void SlopeSimulation::run_of(const std::vector<int>& moved) {
  auto ahead = simulate_ahead(moved);
  const auto behind = simulate_behind(moved);
  parallel_for(static_cast<int>(moved.size()), [&](int m) {
    const FitParameter& parameter = parameters_[moved[m]];
    const double at = now_.value[moved[m]], reach = derivative_step(moved[m]);
    const bool both_sides = !behind[moved[m]].empty();
    const auto reached = [&](double x) { return parameter.circular ? x : parameter.scaled(parameter.natural(x)); };
    const float step = static_cast<float>(both_sides ? reached(at + reach) - reached(at - reach) : reach);
    const std::vector<StatVector>& from = both_sides ? behind[moved[m]] : now_.simulations;
    std::vector<StatVector>& changes = ahead[moved[m]];
    for (int k = 0; k < options_.seeds; ++k)
      for (std::size_t i = 0; i < changes[k].size(); ++i) changes[k][i] = (changes[k][i] - from[k][i]) / step;
    // Where nothing is known nothing changes: beside neighbours that all move along, that would be a trace.
    fill_unknown(experiment_.layout(), changes, true);
    std::vector<Whitened> differences = differences_of(standard_, changes);
    if (draws_map(now_.model, experiment_.forward().catalogue(), parameters_[moved[m]].id))
      for (Whitened& d : differences) forget_bias(experiment_.layout(), d);  // of the typical unit it stays where it is
    pool_noisy(experiment_.layout(), standard_.spread(), least_signal, differences);
    const Whitened& mean = fit_.slopes[moved[m]] =
        shrunk(experiment_.layout(), mean_over_seeds(experiment_.layout(), differences), least_signal);
    for (Whitened& d : differences)
      for (std::size_t i = 0; i < d.size(); ++i)
        if (mean[i] == 0) d[i] = 0;
    fit_.seed_slopes[moved[m]] = std::move(differences);
  });
}

}  // namespace binrig
