#include "diagnose/unit_map_hypotheses.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/screen.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double worth_a_look = 30;  // gain of chi
constexpr double far_behind = 0.05;  // share of what the best hypothesis gains

}  // namespace

UnitMapHypotheses::UnitMapHypotheses(const Experiment& experiment, const Rung& rung, const Measurement& measured,
                                     const Hypotheses& hypotheses, std::uint64_t seed)
    : experiment_(experiment), rung_(rung), measured_(measured), hypotheses_(hypotheses), seed_(seed) {}

bool UnitMapHypotheses::shaped() {
  if (!shaped_) shaped_ = has_simple_shape(experiment_, rung_, measured_.all);
  return *shaped_;
}

void UnitMapHypotheses::learn(std::vector<LinearGain>& linear) {
  std::vector<StatVector> without;
  double best = 0;
  for (const LinearGain& found : linear) best = std::max(best, found.gain);
  for (int h = 0; h < static_cast<int>(hypotheses_.tested.size()); ++h) {
    const Hypothesis& hypothesis = hypotheses_.tested[h];
    if (!hypothesis.declaration->per_unit_map) continue;
    const auto simulate = [&](const SensorModel& model) {
      return experiment_.simulate(UnitMap::trials_of(rung_, model, seed_), "simulating units");
    };
    if (without.empty()) without = simulate(rung_.model);
    UnitMap map(
        experiment_.layout(), rung_, without,
        simulate(with_effect(rung_.model, experiment_.forward().catalogue(), hypothesis.effect, linear[h].values)));
    // A strength is solved for at every gain, so that another one gains no more. What is far behind has its turn when
    // the best one is in the model.
    const double gain = map.gain(rung_.rest, rung_.rest).train;
    if (tracing())
      fmt::print(stderr, "  {} has a map that gains {:.0f}, the best {:.0f}\n", hypothesis.effect, gain, best);
    if (gain > std::max(worth_a_look, far_behind * best) && !map.has_bands(rung_.rest)) {
      UnitMapFit fit = fit_unit_map(experiment_, rung_, hypothesis, linear[h].values, std::move(map), without, seed_);
      linear[h].values = fit.values;
      deviations_[h] = std::move(fit.deviation);
      map = std::move(fit.map);
    }
    if (map.looks_random(rung_.rest) && (map.gain(rung_.rest, rung_.rest, "bias").train < worth_a_look || !shaped())) {
      gains_[h] = map.gain(rung_.rest, rung_.rest);
      linear[h].gain += gains_[h].train;
    }
    maps_.emplace(h, std::move(map));
  }
}

void UnitMapHypotheses::add_gains(const Whitened& rest, std::vector<LinearGain>& gains) const {
  for (const auto& [h, map] : maps_) gains[h].gain += map.gain(rest, rest).train;
}

UnitMap::Gain UnitMapHypotheses::gain(int h) const { return gains_.count(h) ? gains_.at(h) : UnitMap::Gain{}; }

RefinedFit UnitMapHypotheses::given_by_map(int h, const std::map<std::string, double>& values) const {
  RefinedFit result;
  result.fit.model = rung_.model;
  const Hypothesis& hypothesis = hypotheses_.tested[h];
  EffectInstance& instance = add_effect(result.fit.model, experiment_.forward().catalogue(), hypothesis.effect, values);
  result.id = instance.id;
  for (const auto& [name, deviation] : deviations_.at(h)) {
    ParameterValue& value = instance.values[name];
    const ParameterSpec& spec = *hypothesis.declaration->parameter(name);
    const double factor = std::exp(1.96 * deviation);
    value.ci95 = {{std::clamp(value.value / factor, spec.lower, spec.upper),
                   std::clamp(value.value * factor, spec.lower, spec.upper)}};
  }
  return result;
}

}  // namespace binrig
