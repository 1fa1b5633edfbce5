#include "diagnose/happening.h"

#include <algorithm>

#include "diagnose/how_often.h"

namespace binrig {

bool happens_or_not(const EffectDeclaration& effect) {
  const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
  return amplitude && amplitude->kind == ParameterKind::chance;
}

RefinedFit given_by_signatures(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& found,
                               const Ranking& ranking) {
  const Experiment& experiment = refiner.experiment;
  const Rung& rung = refiner.rung;
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  const ParameterSpec& spec = *hypothesis.declaration->parameter(hypothesis.declaration->amplitude);
  std::map<std::string, double> values = found.values;
  const auto found_where = [&](double value) {
    values[spec.name] = value;
    const SensorModel model = with_effect(rung.model, catalogue, hypothesis.effect, values);
    std::vector<Trial> trials;
    for (int k = 0; k < counted_recordings; ++k)
      trials.push_back({model, rung.offsets, refiner.seed + 4000 + static_cast<std::uint64_t>(k), Part::train});
    std::vector<double> result;
    for (const StatVector& recording : experiment.simulate(trials, "refining hypotheses")) {
      const Explained explained = rung.train.explain(rung.standard.linear(recording));
      result.push_back(ranking.gains(explained.rest, explained.values)[found.hypothesis].values.at(spec.name));
    }
    return result;
  };
  const double wanted = found.values.at(spec.name);
  const HowOften often = how_often(found_where, wanted, wanted, spec.lower, spec.upper);
  values[spec.name] = often.value;
  RefinedFit result;
  result.fit.model = rung.model;
  EffectInstance& instance = add_effect(result.fit.model, catalogue, hypothesis.effect, values);
  result.id = instance.id;
  const auto [low, high] = often.interval(1.96);
  instance.values[spec.name].ci95 = {
      {std::clamp(low, spec.lower, spec.upper), std::clamp(high, spec.lower, spec.upper)}};
  return result;
}

}  // namespace binrig
