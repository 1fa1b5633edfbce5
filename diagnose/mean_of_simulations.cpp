#include "diagnose/mean_of_simulations.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace binrig {

std::vector<StatVector> simulate_typical_units(const Experiment& experiment, const std::vector<Trial>& trials,
                                               const std::string& progress, std::vector<StatVector>* as_they_are) {
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  std::vector<StatVector> result = experiment.simulate(trials, progress);
  if (as_they_are) *as_they_are = result;
  std::vector<Trial> plain;
  std::vector<std::size_t> of;
  for (std::size_t t = 0; t < trials.size(); ++t) {
    Trial trial = trials[t];
    std::erase_if(trial.model.effects, [&](const EffectInstance& e) { return e.declaration(catalogue).per_unit_map; });
    if (trial.model.effects.size() == trials[t].model.effects.size()) continue;
    plain.push_back(std::move(trial));
    of.push_back(t);
  }
  if (plain.empty()) return result;
  const auto without = experiment.simulate(plain, progress);
  for (const Block& block : experiment.layout().blocks)
    if (segments()[block.segment].name == "bias")
      for (std::size_t k = 0; k < of.size(); ++k)
        std::copy_n(without[k].begin() + block.offset, block.size, result[of[k]].begin() + block.offset);
  return result;
}

MeanOfSimulations mean_of(const Standard& standard, std::vector<StatVector> simulations) {
  fill_unknown(standard.layout(), simulations);
  const int k = static_cast<int>(simulations.size());
  std::vector<Whitened> y(k);
  parallel_for(k, [&](int j) { y[j] = standard.linear(simulations[j]); });
  MeanOfSimulations result;
  result.mean.assign(y[0].size(), 0.f);
  for (const auto& one : y)
    for (std::size_t i = 0; i < one.size(); ++i) result.mean[i] += one[i] / k;
  if (k > 1) {
    const float scale = 1.f / std::sqrt(k * (k - 1.f));
    result.noise = std::move(y);
    for (auto& one : result.noise)
      for (std::size_t i = 0; i < one.size(); ++i) one[i] = scale * (one[i] - result.mean[i]);
  }
  return result;
}

}  // namespace binrig
