#include "diagnose/superfluous.h"

#include <algorithm>

#include <fmt/format.h>

#include "diagnose/last_step.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double far_worse = 0.5, far_worse_share = 0.02;  // of a held-out score, and of what is left of it
constexpr double hardly_worse = 0.0025;                    // of a proper score, an element
constexpr double hardly_more = 0.02;                       // of a held-out score
constexpr double hardly_its_own = 0.1;                     // share of what an addition took from a held-out score

struct HeldOut {
  double with = 0, without = 0;
  /// Does the model miss the captures held out by so much more without it that no fit would bring it back?
  bool far_off() const { return without > with + far_worse + far_worse_share * std::max(0.0, with - 1); }
};

/// On the scale of the first.
HeldOut held_out(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                 const Rung& with, const Rung& without) {
  const auto judged = scores(experiment.layout(), motions, with, measured.all, {&with, &without});
  return {judged[0].heldout, judged[1].heldout};
}

/// May the strength of what was added last be nothing? The precision of a fit knows nothing of what simulations scatter
/// together: where it leaves the question near, the last step does.
bool strength_is_open(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                      const std::string& id, const EffectDeclaration& effect, std::uint64_t seed) {
  constexpr double near = 4;  // times half of the interval
  if (!may_be_nothing(rung.fit, near * half_intervals(rung.fit, rung.dispersion), id, effect)) return false;
  const bool series = needs_whole_series(rung.model, experiment.forward().catalogue());
  const LastStep step = last_step(experiment, motions, rung, rung.fit.parameters, series, seed);
  return may_be_nothing(rung.fit, 1.96 * step.covariance.diagonal().cwiseMax(0).cwiseSqrt(), id, effect);
}

/// Has what came after it left less than a quarter of its strength?
bool faded(const Climbed& climbed, const CandidateReport& candidate, const EffectDeclaration& effect) {
  constexpr double quarter = 0.25;
  const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
  std::size_t added = climbed.added.size();  // the last time
  while (added > 0 && climbed.added[added - 1] != candidate.effect) --added;
  if (!amplitude || amplitude->neutral != 0.0 || added == 0) return false;
  const EffectInstance *then = climbed.rungs[added - 1].model.find(candidate.id),
                       *now = climbed.rungs.back().model.find(candidate.id);
  return then && now && std::abs(now->value(effect.amplitude)) < quarter * std::abs(then->value(effect.amplitude));
}

}  // namespace

bool take_out_superfluous(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                          const Measurement& measured, Climbed& climbed) {
  const Layout& layout = experiment.layout();
  bool last_one_went = false;
  for (std::size_t k = 0; k < climbed.candidates.size();) {
    const Rung& last = climbed.rungs.back();
    const CandidateReport& candidate = climbed.candidates[k];
    const EffectDeclaration& effect = last.model.find(candidate.id)->declaration(experiment.forward().catalogue());
    const bool is_last = k + 1 == climbed.candidates.size();
    const bool nothing = may_be_nothing(last.fit, half_intervals(last.fit, last.dispersion), candidate.id, effect),
               has_faded = !nothing && faded(climbed, candidate, effect);
    const double slack = nothing || has_faded ? hardly_more : 0;
    if (is_last && !strength_is_open(experiment, motions, last, candidate.id, effect, climbed.options.seed)) break;
    const SensorModel model = without_effect(last.model, candidate.id);
    RungOptions again = climbed.options;
    again.simulations = 8;  // only their mean is looked at
    again.passes = 1;
    again.iterations = 4;
    again.narrow = narrow_of(last.fit.parameters);
    // The last rung's metric lets all other parameters make up for it to first order.
    Rung without = unfitted_rung(experiment, motions, measured, model, last.offsets, again);
    HeldOut judged = held_out(experiment, motions, measured, last, without);
    if (tracing())
      fmt::print(stderr, "  {} left out, unfitted: held-out {:.3f} -> {:.3f}\n", candidate.id, judged.with,
                 judged.without);
    // Below the floor chance moves the score up and down.
    const auto hardly_larger = [&] {
      return judged.without <= (slack > 0 ? std::max(judged.with, 1.0) : judged.with) + slack;
    };
    const auto nobody_misses_it = [&](const SensorModel& without_it) {
      RungOptions as_it_is = again;
      as_it_is.passes = 0;
      const auto proper = [&](const SensorModel& of) {
        return proper_score(layout, fit_rung(experiment, motions, measured, of, last.offsets, as_it_is));
      };
      const double now = proper(last.model), then = proper(without_it);
      if (tracing()) fmt::print(stderr, "  proper {:.4f} -> {:.4f}\n", now, then);
      return then < now + hardly_worse;
    };
    // What the last one brought, with all else fitted anew, the others bring without it.
    const auto others_brought_it = [&](const Rung& rung, const HeldOut& now) {
      const double before =
          held_out(experiment, motions, measured, last, climbed.rungs[climbed.rungs.size() - 2]).without;
      return now.without - now.with < hardly_its_own * (before - now.with) &&
             std::ranges::includes(unexplained(layout, last), unexplained(layout, rung));
    };
    bool superfluous = hardly_larger() && nobody_misses_it(model);
    if (!superfluous && !judged.far_off()) {
      without = fit_rung(experiment, motions, measured, model, last.offsets, again);
      judged = held_out(experiment, motions, measured, last, without);
      if (tracing())
        fmt::print(stderr, "  {} left out: held-out {:.3f} -> {:.3f}\n", candidate.id, judged.with, judged.without);
      superfluous = (hardly_larger() && (!has_faded || nobody_misses_it(without.model))) ||
                    (is_last && others_brought_it(without, judged));
    }
    if (!superfluous) {
      ++k;
      continue;
    }
    climbed.warnings.push_back(fmt::format(
        "{} was added and{} taken out again: without it the error on captures held out is {} larger ({:.3g} with it, "
        "{:.3g} without)",
        candidate.effect, is_last ? ", since what was fitted with it is what helped," : ", with what came after it,",
        judged.without > judged.with ? "hardly" : "no", judged.with, judged.without));
    RungOptions options = climbed.options;
    options.narrow = again.narrow;
    Rung next = fit_rung(experiment, motions, measured, model, last.offsets, options);
    leave_behind(climbed.rungs.back());
    climbed.rungs.push_back(std::move(next));
    climbed.added.push_back("");
    climbed.removed.push_back(candidate.effect);
    climbed.candidates.erase(climbed.candidates.begin() + static_cast<long>(k));
    climbed.evidence.accepted.erase(climbed.evidence.accepted.begin() + static_cast<long>(k));
    last_one_went = is_last;
  }
  return last_one_went;
}

}  // namespace binrig
