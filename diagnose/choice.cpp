#include "diagnose/choice.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/rung.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double told_apart = 0.1;       // dispersion: of ten thousand statistics and more, a thousand of chi
constexpr double hardly_rises = 0.1;     // of a held-out score that stays as it is, by chance
constexpr double clearly_more = 0.25;    // of what is unexplained: so much poses that are off move it
constexpr double hardly_worse = 0.0025;  // by less, the scatter of its own simulations moves the proper score

}  // namespace

double unexplained_excess(const std::vector<SegmentFit>& fits) {
  double excess = 0;
  for (const SegmentFit& fit : fits)
    if (fit.significant()) excess += fit.excess;
  return excess;
}

Choice choose(const Contender& best, const Contender& runner_up, double least_gain) {
  const auto ahead = [](const Contender& winner, const Contender& loser) {
    return winner.dispersion <= leaves_something && loser.dispersion > winner.dispersion + told_apart;
  };
  if (best.dispersion > leaves_something) {
    const double by_best = best.proper_score, by_other = runner_up.proper_score;
    const bool tie = std::abs(by_best - by_other) < hardly_worse;
    const bool other = tie ? runner_up.unexplained() < best.unexplained() : by_other < by_best;
    return {other, other && ahead(runner_up, best)};
  }
  if (runner_up.dispersion > leaves_something) return {false, ahead(best, runner_up)};
  const double left_by_best = best.left_for_other(), left_by_other = runner_up.left_for_other();
  if (tracing()) fmt::print(stderr, "  left for the other: {:.1f}, by it {:.1f}\n", left_by_best, left_by_other);
  if (std::abs(left_by_best - left_by_other) > least_gain) return {left_by_other < left_by_best, true};
  const double by_best = best.unexplained(), by_other = runner_up.unexplained();
  if (tracing()) fmt::print(stderr, "  unexplained by {:.2f}, by {:.2f}\n", by_best, by_other);
  if (std::abs(by_best - by_other) > clearly_more * std::min(by_best, by_other)) {
    const bool by_less = by_other < by_best;
    const Contender &less = by_less ? runner_up : best, &more = by_less ? best : runner_up;
    const bool simpler = more.parameters < less.parameters && more.proper_score < less.proper_score - clearly_lower;
    return {by_less != simpler, false};
  }
  if (best.parameters != runner_up.parameters) return {runner_up.parameters < best.parameters, false};
  return {left_by_other < left_by_best, false};
}

bool makes_better(const Left& before, const Left& after, const Addition& addition) {
  constexpr double least_fall = 0.02;     // share of what is left of the held-out score
  constexpr double next_to_none = 0.01;   // of the held-out score: no reason if the proper one does not fall
  constexpr double unproven_fall = 0.25;  // of what an effect that had not proved itself has to take of that
  constexpr double most = 0.5;            // of what is left of the statistics
  const double excess = std::max(0.0, before.heldout - 1), rise = after.proper_score - before.proper_score;
  // Below the floor chance moves the held-out score up and down; what the proper one gets worse by counts there, and
  // sooner where nothing was unexplained.
  // Where nothing is unexplained any more, it may be twice that: masks do not come back to where they were.
  const bool explains_all = !before.unexplained.empty() && after.unexplained.empty();
  // Where poses and lens alone are off, whatever blurs the statistics lets them come back.
  const bool blurs = rise >= (explains_all ? clearly_lower : hardly_worse) &&
                     std::ranges::all_of(before.unexplained, [](const auto& left) {
                       return left.first == "poses" || left.first == "intrinsics";
                     });
  const bool neither_falls = rise >= 0 && after.heldout > before.heldout - next_to_none;
  const bool gets_worse = (excess == 0 && rise >= (explains_all ? 2 : 1) * clearly_lower) || blurs ||
                          (rise > 0 && addition.draws) || neither_falls;
  const double fall = addition.unproven ? std::max(hardly_rises, unproven_fall * excess) : least_fall * excess;
  if (!gets_worse && after.heldout <= before.heldout - fall) return true;
  if (addition.happens_or_not && !blurs && leaves_less(before.unexplained, after.unexplained)) return true;
  // What had not proved itself beside bent parameters does so where nothing is left with it, and something was before.
  if (addition.unproven)
    return explains_all && rise <= -hardly_worse && after.heldout <= std::min(before.heldout, 1.0);
  const bool hardly_rose = after.heldout < before.heldout + std::max(hardly_rises, least_fall * excess);
  const bool had_gone_far = before.statistics < before.heldout;
  const bool explains = had_gone_far && after.statistics - 1 < (1 - most) * (before.statistics - 1);
  // Three numbers of the lens are as large a part of the held-out score as thousands of cells: chance in them may hide
  // that the statistics are nearer, or that everything is explained now.
  const bool lens_rose =
      before.unexplained.empty() && after.unexplained.empty() && after.statistics < before.statistics + hardly_rises;
  return addition.by_its_map || (rise <= -clearly_lower && (hardly_rose || explains || lens_rose)) ||
         (rise < 0 && hardly_rose && explains_all);
}

bool takes_the_place(const Left& present, const Left& other) {
  constexpr double much = 0.25, at_least = 0.1;
  const bool properly = other.proper_score < present.proper_score - clearly_lower && other.heldout <= present.heldout;
  const bool held_out = other.heldout < present.heldout - std::max(at_least, much * (present.heldout - 1)) &&
                        other.proper_score < present.proper_score + hardly_worse;
  return properly || held_out;
}

bool as_good(const Left& present, const Left& other) {
  constexpr double hardly_more = 0.02;
  return other.heldout < present.heldout + hardly_more && std::ranges::includes(present.unexplained, other.unexplained);
}

bool does_for_two(const Left& present, const Left& other) {
  const double rise = other.proper_score - present.proper_score;
  const bool lower = rise < 0 && other.heldout < present.heldout + hardly_rises &&
                     std::ranges::includes(present.unexplained, other.unexplained);
  const double at_most = (other.heldout < present.heldout ? 2 : 1) * hardly_worse;
  return lower || (as_good(present, other) && rise < at_most);
}

bool two_do_better(const Left& present, const Left& two) {
  constexpr double clearly = 0.02;
  return does_for_two(present, two) && two.heldout < present.heldout - clearly;
}

bool hardly_there(const EffectDeclaration& effect, double amplitude) {
  const ParameterSpec* spec = effect.parameter(effect.amplitude);
  return spec && effect.stronger_is_larger && spec->neutral == 0.0 &&
         std::abs(amplitude) < 0.5 * std::min(std::abs(spec->typical_low), std::abs(spec->typical_high));
}

bool leaves_less(const Leftovers& before, const Leftovers& after) {
  return after.size() < before.size() && std::ranges::includes(before, after);
}

}  // namespace binrig
