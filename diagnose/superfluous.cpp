#include "diagnose/superfluous.h"

#include <algorithm>

#include <fmt/format.h>

#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double far_worse = 0.5, far_worse_share = 0.02;  // of a held-out score, and of what is left of it

/// Does a model miss the captures held out by so much more than the last one that no fit would bring it back?
bool is_far_worse(const Experiment& experiment, const Measurement& measured, const Rung& last, const Rung& unfitted) {
  const auto judged = scores(experiment.layout(), last, measured.all, {last, unfitted});
  const double with = judged[0].heldout, without = judged[1].heldout;
  if (tracing()) fmt::print(stderr, "  unfitted: held-out {:.3f}, without {:.3f}\n", with, without);
  return without > with + far_worse + far_worse_share * std::max(0.0, with - 1);
}

}  // namespace

void take_out_superfluous(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                          const Measurement& measured, Climbed& climbed) {
  for (std::size_t k = 0; k + 1 < climbed.candidates.size();) {
    const Rung& last = climbed.rungs.back();
    const CandidateReport& candidate = climbed.candidates[k];
    const SensorModel without = without_effect(last.model, candidate.id);
    RungOptions again = climbed.options;
    again.simulations = 8;  // only their mean is looked at
    again.passes = 1;
    again.iterations = 4;
    again.narrow = narrow_of(last.fit.parameters);
    // The last rung's metric lets all other parameters make up for it to first order.
    if (is_far_worse(experiment, measured, last,
                     unfitted_rung(experiment, motions, measured, without, last.offsets, again))) {
      ++k;
      continue;
    }
    std::vector<Rung> pair{last, fit_rung(experiment, motions, measured, without, last.offsets, again)};
    const auto judged = scores(experiment.layout(), pair[0], measured.all, pair);
    if (tracing())
      fmt::print(stderr, "  without {}: held-out {:.3f} -> {:.3f}\n", candidate.id, judged[0].heldout,
                 judged[1].heldout);
    if (judged[1].heldout > judged[0].heldout) {
      ++k;
      continue;
    }
    climbed.warnings.push_back(fmt::format(
        "{} was added and, with what came after it, taken out again: without it the error on captures held out is no "
        "larger ({:.3g} with it, {:.3g} without)",
        candidate.effect, judged[0].heldout, judged[1].heldout));
    climbed.rungs.push_back(std::move(pair[1]));
    climbed.added.push_back("");
    climbed.removed.push_back(candidate.effect);
    climbed.candidates.erase(climbed.candidates.begin() + static_cast<long>(k));
    climbed.evidence.accepted.erase(climbed.evidence.accepted.begin() + static_cast<long>(k));
  }
}

}  // namespace binrig
