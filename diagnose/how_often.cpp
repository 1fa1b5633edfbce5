#include "diagnose/how_often.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/slopes.h"
#include "diagnose/trace.h"

namespace binrig {

double HowOften::deviation() const { return std::sqrt(scatter * value); }

std::pair<double, double> HowOften::interval(double t) const {
  const double square = t * t * scatter;
  const double middle = value + square / 2, half = std::sqrt(square * (value + square / 4));
  return {middle - half, middle + half};
}

HowOften how_often(const std::function<std::vector<double>(double value)>& found_where, double found, double start,
                   double lower, double upper) {
  constexpr int rounds = 2;  // the measure is not quite proportional
  HowOften result{start, 0};
  for (int round = 0; round < rounds && result.value > 0; ++round) {
    const std::vector<double> simulated = found_where(result.value);
    const double count = static_cast<double>(simulated.size());
    double sum = 0, square = 0;
    for (const double one : simulated) sum += one, square += one * one;
    const double mean = sum / count, variance = std::max(0.0, square - sum * mean) / (count - 1);
    if (mean <= 0) break;
    result.scatter = variance / (mean * mean) * result.value;
    result.value = std::clamp(result.value * found / mean, lower, upper);
    if (tracing())
      fmt::print(stderr, "  found {:.4g}, where it is so {:.4g}: {:.4g} +- {:.4g}\n", found, mean, result.value,
                 result.deviation());
  }
  return result;
}

HowOften count_occurrences(const Experiment& experiment, const Rung& rung, const SensorModel& model,
                           const std::string& id, const ParameterSpec& spec, int row, std::uint64_t seed) {
  constexpr double least_signal = 0.3;
  const Layout& layout = experiment.layout();
  const Metric others = rung.train.with_held({row});
  const auto simulated = [&](double value, std::uint64_t first_seed) {
    SensorModel with = model;
    value_in(with, id, spec.name).value = value;
    std::vector<Trial> trials;
    for (std::uint64_t k = 0; k < counted_recordings; ++k)
      trials.push_back({with, rung.offsets, first_seed + k, Part::train});
    std::vector<Whitened> rests;
    for (const StatVector& one : experiment.simulate(trials, "counting what happens to whole frames"))
      rests.push_back(others.explain(rung.standard.linear(one), rung.place).rest);
    return rests;
  };
  const double middle = std::sqrt(spec.typical_low * spec.typical_high);
  const std::vector<Whitened> never = simulated(spec.lower, seed);
  std::vector<Whitened> changes = simulated(middle, seed);
  for (int k = 0; k < counted_recordings; ++k)
    for (int i = 0; i < layout.size; ++i) changes[k][i] -= never[k][i];
  pool_noisy(layout, rung.standard.spread(), least_signal, changes);
  const Whitened trace = shrunk(layout, mean_over_seeds(layout, changes), least_signal);
  const double none = dot(trace, mean_over_seeds(layout, never).mean);
  const auto found_where = [&](double value) {
    std::vector<double> found;
    for (const Whitened& rest : simulated(value, seed + 1000)) found.push_back(dot(trace, rest) - none);
    return found;
  };
  const double found = dot(trace, others.explain(rung.data, rung.place).rest) - none;
  return how_often(found_where, found, middle, spec.lower, spec.upper);
}

}  // namespace binrig
