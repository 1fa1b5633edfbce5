#include "diagnose/map_hypotheses.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "diagnose/score.h"
#include "diagnose/screen.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double worth_a_look = 30;  // gain of chi
constexpr double far_behind = 0.05;  // share of what the best hypothesis gains
constexpr double noise_is_off = 2;   // of what the rung's own randomness leaves

/// Could noise from frame to frame of which the rung knows too little be what is left of the bias? Noise k times as
/// strong as the rung's, in all or in a ring of its spectrum, leaves k times as much in the mean of a capture's frames,
/// and more in its own statistics, which are made of all frames.
bool may_be_noise(const Layout& layout, const Rung& rung) {
  double bias = 0, noise = 0;
  for (const SegmentFit& fit : goodness_of_fit(layout, rung)) {
    if (!fit.train) continue;
    if (fit.segment == "bias") bias = fit.ratio;
    if (fit.segment == "noise" || fit.segment == "spectrum") noise = std::max(noise, fit.ratio);
  }
  return noise > std::max(noise_is_off, bias);
}

}  // namespace

MapHypotheses::MapHypotheses(const Experiment& experiment, const Rung& rung, const Measurement& measured,
                             const Hypotheses& hypotheses, std::set<std::string> no_maps, std::uint64_t seed)
    : experiment_(experiment),
      rung_(rung),
      measured_(measured),
      hypotheses_(hypotheses),
      no_maps_(std::move(no_maps)),
      seed_(seed) {}

bool MapHypotheses::shaped() {
  if (!shaped_) shaped_ = has_simple_shape(experiment_, rung_, measured_.all);
  return *shaped_;
}

std::vector<StatVector> MapHypotheses::simulate(const SensorModel& model) const {
  return experiment_.simulate(UnitMap::trials_of(rung_, model, seed_), "simulating units");
}

std::vector<StatVector> MapHypotheses::simulate_with(const Hypothesis& hypothesis,
                                                     const std::map<std::string, double>& values) const {
  return simulate(with_effect(rung_.model, experiment_.forward().catalogue(), hypothesis.effect, values));
}

void MapHypotheses::learn(std::vector<LinearGain>& linear) {
  std::vector<StatVector> without;
  double best = 0;
  const bool draws_show = !may_be_noise(experiment_.layout(), rung_);
  for (const LinearGain& found : linear) best = std::max(best, found.gain);
  for (LinearGain& found : linear) {
    const EffectDeclaration& effect = *hypotheses_.tested[found.hypothesis].declaration;
    if (!effect.per_unit_map && !(effect.per_capture_map && draws_show)) continue;
    if (without.empty()) without = simulate(rung_.model);
    if (effect.per_unit_map)
      learn_map(found, without, best);
    else
      learn_draws(found, without);
  }
}

void MapHypotheses::learn_map(LinearGain& linear, const std::vector<StatVector>& without, double best) {
  const int h = linear.hypothesis;
  const Hypothesis& hypothesis = hypotheses_.tested[h];
  const auto units = simulate_with(hypothesis, linear.values);
  UnitMapFit& fit =
      maps_.insert_or_assign(h, UnitMapFit{linear.values, UnitMap(experiment_.layout(), rung_, without, units), {}})
          .first->second;
  // A strength is solved for at every gain, so that another one gains no more. What is far behind has its turn when
  // the best one is in the model.
  const double gain = fit.map.gain(rung_.rest, rung_.rest).train;
  if (tracing())
    fmt::print(stderr, "  {} has a map that gains {:.0f}, the best {:.0f}\n", hypothesis.effect, gain, best);
  const bool worth_it = gain > std::max(worth_a_look, far_behind * best) && !no_maps_.contains(hypothesis.effect);
  if (worth_it && !fit.map.has_bands(rung_.rest)) {
    fit = fit_unit_map(experiment_, rung_, hypothesis, linear.values, std::move(fit.map), without, seed_);
    linear.values = fit.values;
  }
  const UnitMap& map = fit.map;
  if (map.looks_random(rung_.rest) && (map.gain(rung_.rest, rung_.rest, "bias").train < worth_a_look || !shaped())) {
    gains_[h] = map.gain(rung_.rest, rung_.rest);
    linear.gain += gains_[h].train;
  }
}

void MapHypotheses::learn_draws(LinearGain& linear, const std::vector<StatVector>& without) {
  const Hypothesis& hypothesis = hypotheses_.tested[linear.hypothesis];
  const ParameterSpec& amplitude = *hypothesis.declaration->parameter(hypothesis.declaration->amplitude);
  const double medium = strength_value(*hypothesis.declaration, Strength::medium);
  struct Tried {
    std::map<std::string, double> values;
    DrawnMap map;
    DrawnMap::Gain gain;
  };
  std::optional<Tried> best;
  // The linear view sees of it the little that all draws have in common, and says nothing of its parameters.
  for (const StrengthPath& path : hypothesis.paths) {
    auto values = path.atoms.front().values;
    values[amplitude.name] = medium;
    DrawnMap map(experiment_.layout(), rung_, without, simulate_with(hypothesis, values));
    const DrawnMap::Gain gain = map.gain(rung_.rest, rung_.rest);
    if (tracing())
      fmt::print(stderr, "  {} draws maps that gain {:.0f}, on test {:.0f}, at {:.2f} of a medium one's power, {}\n",
                 hypothesis.effect, gain.train, gain.test, gain.strength, gain.alike ? "alike" : "unlike");
    const auto worth = [](const DrawnMap::Gain& g) { return std::pair(g.alike, g.train); };
    if (!best || worth(gain) > worth(best->gain)) best = Tried{std::move(values), std::move(map), gain};
    if (best->gain.train < worth_a_look) break;
  }
  const DrawnMap::Gain& gain = best->gain;
  if (gain.alike && gain.train > worth_a_look && gain.test > 0) {
    gains_[linear.hypothesis] = {gain.train, gain.test};
    linear.gain += gain.train;
    linear.values = best->values;
    linear.values[amplitude.name] = std::clamp(medium * std::sqrt(gain.strength), amplitude.lower, amplitude.upper);
  }
  drawn_.emplace(linear.hypothesis, std::move(best->map));
}

void MapHypotheses::add_gains(const Whitened& rest, std::vector<LinearGain>& gains) const {
  for (const auto& [h, fit] : maps_) gains[h].gain += fit.map.gain(rest, rest).train;
  for (const auto& [h, map] : drawn_)
    if (const DrawnMap::Gain gain = map.gain(rest, rest); gain.alike) gains[h].gain += gain.train;
}

std::set<std::string> MapHypotheses::unlike() const {
  std::set<std::string> result = no_maps_;
  for (const auto& [h, fit] : maps_)
    if (fit.information && !gains_.count(h)) result.insert(hypotheses_.tested[h].effect);
  return result;
}

UnitMap::Gain MapHypotheses::gain(int h) const { return gains_.count(h) ? gains_.at(h) : UnitMap::Gain{}; }

RefinedFit MapHypotheses::given_by_map(int h, const std::map<std::string, double>& values) const {
  RefinedFit result;
  result.fit.model = rung_.model;
  const Hypothesis& hypothesis = hypotheses_.tested[h];
  EffectInstance& instance = add_effect(result.fit.model, experiment_.forward().catalogue(), hypothesis.effect, values);
  result.id = instance.id;
  for (const auto& [name, deviation] : unit_map_deviations(experiment_, rung_, hypothesis, maps_.at(h), seed_)) {
    ParameterValue& value = instance.values[name];
    const ParameterSpec& spec = *hypothesis.declaration->parameter(name);
    const double factor = std::exp(1.96 * deviation);
    value.ci95 = {{std::clamp(value.value / factor, spec.lower, spec.upper),
                   std::clamp(value.value * factor, spec.lower, spec.upper)}};
  }
  return result;
}

}  // namespace binrig
