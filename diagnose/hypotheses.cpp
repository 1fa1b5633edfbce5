#include "diagnose/hypotheses.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "diagnose/experiment.h"

namespace binrig {
namespace {

constexpr double half_pi = 1.57079632679489662;

double clip(const ParameterSpec& spec, double value) {
  value = std::clamp(value, spec.lower, spec.upper);
  return spec.kind == ParameterKind::integer ? std::round(value) : value;
}

/// A share 0..1 of the way from the typical range's low to its high end.
double along(const ParameterSpec& spec, double share) {
  const double a = spec.typical_low, b = spec.typical_high;
  if (spec.log_scaled && a > 0 && b > 0) return clip(spec, a * std::pow(b / a, share));
  return clip(spec, a + share * (b - a));
}

/// Amplitude nodes from weak to strong.
std::vector<double> amplitudes(const EffectDeclaration& effect, const ParameterSpec& spec, bool many) {
  std::vector<double> nodes;
  const bool discrete = !spec.interpolate || spec.kind == ParameterKind::integer;
  if (discrete) {
    for (double share : {0.15, 0.5, 0.85}) nodes.push_back(along(spec, effect.stronger_is_larger ? share : 1 - share));
  } else {
    nodes.push_back(clip(spec, strength_value(effect, Strength::medium)));
    if (many) nodes.push_back(clip(spec, strength_value(effect, Strength::strong)));
  }
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  return nodes;
}

bool is_discrete(const ParameterSpec& spec) { return !spec.interpolate || spec.kind == ParameterKind::integer; }

/// Two parameters that each value stands for itself in are a place in the image; else none.
std::vector<const ParameterSpec*> place_of(const EffectDeclaration& effect) {
  std::vector<const ParameterSpec*> place;
  for (const auto& spec : effect.parameters)
    if (spec.name != effect.amplitude && spec.either_sign && is_discrete(spec)) place.push_back(&spec);
  if (place.size() != 2) place.clear();
  return place;
}

/// Each value is another trace that nothing else brings nearer.
bool stands_for_itself(const ParameterSpec& spec) {
  return is_discrete(spec) && spec.log_scaled && spec.typical_low > 0;
}

constexpr double overlapping = 0.3;                       // of values on a logarithmic scale
constexpr double columns_apart = 0.32, rows_apart = 0.3;  // of a grid of places, of half the image's width

Hypothesis make(const EffectDeclaration& effect) {
  Hypothesis hypothesis{effect.name, &effect, {}, {}};
  const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
  if (!amplitude) return hypothesis;

  std::map<std::string, double> initial;
  const ParameterSpec* phase = nullptr;
  for (const auto& spec : effect.parameters) {
    initial[spec.name] = spec.initial;
    if (spec.kind == ParameterKind::phase && &spec != amplitude) phase = &spec;
  }
  const auto place = place_of(effect);
  // The other parameters one at a time about their initial values: enough for the shortlist, which is then refined.
  std::vector<std::map<std::string, double>> shapes{initial};
  std::vector<bool> detail{false};
  for (const auto& spec : effect.parameters) {
    if (&spec == amplitude || spec.kind == ParameterKind::phase || spec.typical_low == spec.typical_high) continue;
    std::vector<double> values;
    // So close that two side by side overlap.
    const bool many = stands_for_itself(spec) && !phase && place.empty();
    const int steps =
        many ? std::max(1, static_cast<int>(std::log(spec.typical_high / spec.typical_low) / overlapping)) : 1;
    for (int k = 0; k <= steps; ++k) {
      const double value = along(spec, 0.15 + 0.7 * k / steps);
      if (std::abs(value - spec.initial) > 1e-9) values.push_back(value);
    }
    if (spec.either_sign) values.push_back(clip(spec, -along(spec, 0.5)));
    for (double value : values) {
      shapes.push_back(initial);
      shapes.back()[spec.name] = value;
      detail.push_back(!is_discrete(spec));  // of periods and places, each value is another trace
    }
  }
  // A grid of places, so close that a strong atom on each leaves no gap.
  const std::size_t first_place = shapes.size();
  if (!place.empty())
    for (int row = 0; row < 5; ++row)
      for (int col = 0; col < 6; ++col) {
        shapes.push_back(placed_at(effect, initial, (-0.8 + columns_apart * col) * place[0]->typical_high,
                                   (-0.6 + rows_apart * row) * place[1]->typical_high));
      }
  detail.resize(shapes.size(), false);
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    StrengthPath path;
    path.detail = detail[k];
    path.one_of_many = k >= first_place;
    path.interpolate = !is_discrete(*amplitude);
    // Pixels that come and go do not come and go the other way round, and what changes from frame to frame makes noise
    // whichever way it goes.
    path.mirror = amplitude->either_sign && path.interpolate && !effect.may_clear && !needs_whole_series(effect.needs);
    for (double a : amplitudes(effect, *amplitude, k == 0 && !phase)) {
      Atom atom{shapes[k]};
      atom.values[effect.amplitude] = a;
      if (k >= first_place) atom.values[effect.amplitude] = clip(*amplitude, strength_value(effect, Strength::strong));
      path.atoms.push_back(atom);
    }
    if (phase)
      for (auto& atom : path.atoms) atom.values[phase->name] = 0;
    hypothesis.paths.push_back(path);
    if (phase) {
      StrengthPath quarter = path;
      quarter.quadrature_of = static_cast<int>(hypothesis.paths.size()) - 1;
      for (auto& atom : quarter.atoms) atom.values[phase->name] = half_pi;
      hypothesis.paths.push_back(quarter);
    }
    if (amplitude->either_sign && !path.mirror) {
      StrengthPath negative = path;
      for (auto& atom : negative.atoms)
        atom.values[effect.amplitude] = clip(*amplitude, -atom.values[effect.amplitude]);
      hypothesis.paths.push_back(negative);
    }
  }
  return hypothesis;
}

/// Of an amplitude that is a step, each value is another trace, and only one of them meets the recording's lines.
void add_seen(const SeenSteps& seen, Hypothesis& hypothesis) {
  if (!is_step(*hypothesis.declaration)) return;
  const ParameterSpec* amplitude = hypothesis.declaration->parameter(hypothesis.declaration->amplitude);
  for (const ReadStep& step : seen.of(*amplitude))
    if (amplitude->lower <= step.value && step.value <= amplitude->upper) hypothesis.seen.push_back(step);
  for (StrengthPath& path : hypothesis.paths) {
    const Atom like = path.atoms.front();
    for (const ReadStep& step : hypothesis.seen) {
      path.atoms.push_back(like);
      path.atoms.back().values[amplitude->name] = step.value;
    }
  }
}

/// Phase and period of an effect that has both; else null.
struct Wave {
  const ParameterSpec *phase = nullptr, *period = nullptr;
};

Wave wave_of(const EffectDeclaration& effect) {
  Wave wave;
  for (const auto& spec : effect.parameters) {
    if (spec.kind == ParameterKind::phase)
      wave.phase = &spec;
    else if (!spec.interpolate && spec.log_scaled && spec.name != effect.amplitude)
      wave.period = &spec;
  }
  return wave.phase && wave.period ? wave : Wave{};
}

int periods_across(int cols) { return cols / 4; }

double frequency_step(const ParameterSpec& period, int cols) {
  return (1 / period.typical_low - 1 / period.typical_high) / std::max(1, periods_across(cols) - 1);
}

/// One hypothesis a period, of any phase, at medium strength. None if it has no strength.
std::vector<Hypothesis> at_periods(const Hypothesis& hypothesis, const std::map<std::string, double>& values,
                                   const std::vector<double>& periods) {
  const EffectDeclaration& effect = *hypothesis.declaration;
  const auto [phase, period] = wave_of(effect);
  const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
  std::vector<Hypothesis> result;
  for (std::size_t k = 0; amplitude && k < periods.size(); ++k) {
    result.push_back({hypothesis.effect, &effect, {}, {}});
    Atom atom{values};
    atom.values[amplitude->name] = clip(*amplitude, strength_value(effect, Strength::medium));
    atom.values[period->name] = periods[k];
    for (const double quarter : {0.0, half_pi}) {
      StrengthPath path;
      atom.values[phase->name] = quarter;
      path.atoms = {atom};
      path.one_of_many = true;
      if (quarter > 0) path.quadrature_of = 0;
      result.back().paths.push_back(path);
    }
  }
  return result;
}

}  // namespace

const ReadStep* Hypothesis::seen_at(const std::map<std::string, double>& values) const {
  const auto amplitude = values.find(declaration->amplitude);
  if (amplitude == values.end()) return nullptr;
  const auto step = std::ranges::find(seen, amplitude->second, &ReadStep::value);
  return step == seen.end() ? nullptr : &*step;
}

SensorModel with_effect(const SensorModel& model, const EffectCatalogue& catalogue, const std::string& effect,
                        const std::map<std::string, double>& values) {
  SensorModel result = model;
  add_effect(result, catalogue, effect, values);
  return result;
}

SensorModel without_effect(SensorModel model, const std::string& id) {
  std::erase_if(model.effects, [&](const EffectInstance& effect) { return effect.id == id; });
  return model;
}

std::vector<Hypothesis> by_period(const Hypothesis& hypothesis, const std::map<std::string, double>& values, int cols) {
  const ParameterSpec* period = wave_of(*hypothesis.declaration).period;
  if (!period) return {};
  std::vector<double> periods{values.at(period->name)};
  for (int k = 0; k < periods_across(cols); ++k)
    periods.push_back(1 / (1 / period->typical_high + k * frequency_step(*period, cols)));
  return at_periods(hypothesis, values, periods);
}

std::vector<Hypothesis> by_period_near(const Hypothesis& hypothesis, const std::map<std::string, double>& values,
                                       int cols) {
  const ParameterSpec* period = wave_of(*hypothesis.declaration).period;
  if (!period) return {};
  std::vector<double> periods;
  for (int k = -3; k <= 3; ++k)
    periods.push_back(clip(*period, 1 / (1 / values.at(period->name) + 0.25 * k * frequency_step(*period, cols))));
  return at_periods(hypothesis, values, periods);
}

bool has_period(const EffectDeclaration& effect) { return wave_of(effect).period; }

bool has_tone(const EffectDeclaration& effect) {
  return place_of(effect).empty() &&
         std::ranges::none_of(effect.parameters,
                              [](const ParameterSpec& spec) { return spec.kind == ParameterKind::phase; }) &&
         std::ranges::any_of(effect.parameters, [&](const ParameterSpec& spec) {
           return spec.name != effect.amplitude && stands_for_itself(spec);
         });
}

bool has_place(const EffectDeclaration& effect) { return !place_of(effect).empty(); }

bool is_step(const EffectDeclaration& effect, const ParameterSpec& spec) {
  return spec.name == effect.amplitude && !spec.interpolate && spec.log_scaled && spec.kind != ParameterKind::integer;
}

bool is_step(const EffectDeclaration& effect) {
  const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
  return amplitude && is_step(effect, *amplitude);
}

Hypothesis by_place(const Hypothesis& hypothesis, const std::map<std::string, double>& values,
                    std::optional<double> reach) {
  constexpr int steps = 3;  // to either side
  const EffectDeclaration& effect = *hypothesis.declaration;
  const auto place = place_of(effect);
  const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
  Hypothesis result{hypothesis.effect, &effect, {}, {}};
  if (place.empty() || !amplitude) return result;
  const auto moved = [&](int axis, int by, double apart) {
    return values.at(place[axis]->name) + by * reach.value_or(apart * place[axis]->typical_high) / steps;
  };
  for (int row = -steps; row <= steps; ++row)
    for (int col = -steps; col <= steps; ++col) {
      StrengthPath path;
      path.one_of_many = true;
      for (const Strength strength : {Strength::weak, Strength::medium, Strength::strong}) {
        Atom atom{placed_at(effect, values, moved(0, col, columns_apart), moved(1, row, rows_apart))};
        atom.values[amplitude->name] = clip(*amplitude, strength_value(effect, strength));
        path.atoms.push_back(atom);
      }
      result.paths.push_back(path);
    }
  return result;
}

std::map<std::string, double> placed_at(const EffectDeclaration& effect, std::map<std::string, double> values, double x,
                                        double y) {
  const auto place = place_of(effect);
  values[place[0]->name] = clip(*place[0], x);
  values[place[1]->name] = clip(*place[1], y);
  return values;
}

double period_spacing(const ParameterSpec& period, double value, int cols) {
  return frequency_step(period, cols) * value;
}

Hypotheses make_hypotheses(const ForwardModel& forward, const SensorModel& model, const SeenSteps& seen) {
  Hypotheses result;
  const EffectCatalogue& catalogue = forward.catalogue();
  for (const EffectDeclaration* effect : catalogue.all()) {
    if (effect->user_defined) continue;
    const bool present = std::any_of(model.effects.begin(), model.effects.end(),
                                     [&](const EffectInstance& e) { return e.effect == effect->name; });
    if (present) continue;
    Hypothesis hypothesis = make(*effect);
    if (hypothesis.paths.empty()) continue;
    add_seen(seen, hypothesis);
    try {
      const SensorModel extended = with_effect(model, catalogue, effect->name, hypothesis.paths[0].atoms[0].values);
      bool able = true;
      for (const auto& [id, reason] : forward.inactive(extended))
        if (!model.find(id)) able = false;
      if (able)
        result.tested.push_back(std::move(hypothesis));
      else
        result.untested.push_back({effect->name, effect->needs.words()});
    } catch (const Error&) {
      result.untested.push_back({effect->name, effect->needs.words()});
    }
  }
  return result;
}

}  // namespace binrig
