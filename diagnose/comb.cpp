#include "diagnose/comb.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "diagnose/hypotheses.h"
#include "diagnose/last_step.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double far_better = 100;                   // of chi: what a wrong valley costs, and roughness hardly
constexpr int values = 24;                           // tried to either side
constexpr double near_factor = 1.5, equal = 0.0001;  // of a step that was read off the values
/// Relative. A hundred steps within the range shift by a fourteenth of one, then by less, and once more: noise that is
/// still bent hides the last of the way.
constexpr double spacings[] = {0.0007, 0.0002, 0.0002};

struct Step {
  std::string id;
  const ParameterSpec* spec;
};

std::vector<Step> steps_of(const SensorModel& model, const EffectCatalogue& catalogue,
                           const std::vector<std::string>& fixed) {
  std::vector<Step> steps;
  for (const EffectInstance& instance : model.effects) {
    const EffectDeclaration& declaration = instance.declaration(catalogue);
    const ParameterSpec* spec = declaration.parameter(declaration.amplitude);
    if (spec && is_step(declaration, *spec) &&
        std::find(fixed.begin(), fixed.end(), instance.id + "." + spec->name) == fixed.end())
      steps.push_back({instance.id, spec});
  }
  return steps;
}

}  // namespace

void comb_steps(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                const SensorModel& start, const SeenSteps& seen, const RungOptions& options, Rung& rung) {
  const std::vector<Step> steps = steps_of(start, experiment.forward().catalogue(), options.fixed);
  RungOptions again = options;
  again.passes = 1;
  again.scan_all_ranges = false;
  again.narrow = narrow_of(rung.fit.parameters);
  for (const Step& step : steps) again.fixed.push_back(step.id + "." + step.spec->name);
  FitOptions look;
  look.seed = options.seed + 500;
  look.place.assign(motions.size(), 0);
  look.motions = &motions;
  const auto leaves_some = [&] {  // on train
    return std::ranges::any_of(unexplained(experiment.layout(), rung), [](const auto& left) { return left.second; });
  };
  const auto train_score = [&](const Rung& of) { return proper_score(experiment.layout(), of, Part::train); };
  // Where several effects are missing, what a comb meets is theirs.
  if (steps.empty() || rung.dispersion > many_missing) return;
  for (const Step& step : steps)
    for (const ReadStep& read : seen.of(*step.spec)) {
      SensorModel model = rung.model;
      double& value = value_in(model, step.id, step.spec->name).value;
      const double ratio = read.value / value;
      if (std::max(ratio, 1 / ratio) > near_factor || std::abs(ratio - 1) < equal) continue;
      value = std::clamp(read.value, step.spec->lower, step.spec->upper);
      Rung other = fit_rung(experiment, motions, measured, model, {}, again);
      const double before = train_score(rung), after = train_score(other);
      if (tracing())
        fmt::print(stderr, "{}.{} as read, {:.5g}: proper on train {:.5f} -> {:.5f}\n", step.id, step.spec->name,
                   read.value, before, after);
      if (after < before) rung = std::move(other);
    }
  for (const double spacing : spacings) {
    if (!leaves_some()) return;
    const Metric metric(experiment.layout(), Part::train, motion_rows(experiment.layout(), rung.standard, motions));
    // From where targets nominally stand: about where a wrong step put them, the right one looks wrong.
    const auto chi_of = [&](const SensorModel& model) {
      return fit_model(experiment, rung.standard, metric, rung.data, model, {}, {}, look).chi;
    };
    SensorModel best = rung.model;
    const double before = chi_of(best);
    double least = before;
    for (const Step& step : steps) {
      const double reached = best.find(step.id)->value(step.spec->name);
      const std::set<double> middles{reached, start.find(step.id)->value(step.spec->name)};
      SensorModel tried = best;
      for (const double middle : middles)
        for (int k = -values; k <= values; ++k) {
          value_in(tried, step.id, step.spec->name).value =
              std::clamp(middle * (1 + spacing * k), step.spec->lower, step.spec->upper);
          if (const double chi = chi_of(tried); chi < least) least = chi, best = tried;
        }
      if (tracing())
        fmt::print(stderr, "{}.{} combed: {:.5g}, then {:.5g}, chi {:.0f} less\n", step.id, step.spec->name, reached,
                   best.find(step.id)->value(step.spec->name), before - least);
    }
    if (least >= before) return;
    Rung other = fit_rung(experiment, motions, measured, best, {}, again);
    if (before - least < far_better * rung.dispersion && train_score(other) >= train_score(rung)) return;
    rung = std::move(other);
  }
}

}  // namespace binrig
