#include "diagnose/choice.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/rung.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double told_apart = 0.1;  // dispersion: of ten thousand statistics and more, a thousand of chi

}  // namespace

Choice choose(const Contender& best, const Contender& runner_up, double least_gain) {
  const auto ahead = [](const Contender& winner, const Contender& loser) {
    return winner.dispersion <= leaves_something && loser.dispersion > winner.dispersion + told_apart;
  };
  if (best.dispersion > leaves_something) {
    const bool other = runner_up.proper_score < best.proper_score;
    return {other, other && ahead(runner_up, best)};
  }
  if (runner_up.dispersion > leaves_something) return {false, ahead(best, runner_up)};
  const double left_by_best = best.left_for_other(), left_by_other = runner_up.left_for_other();
  if (tracing()) fmt::print(stderr, "  left for the other: {:.1f}, by it {:.1f}\n", left_by_best, left_by_other);
  if (std::abs(left_by_best - left_by_other) > least_gain) return {left_by_other < left_by_best, true};
  const std::size_t by_best = best.unexplained().size(), by_other = runner_up.unexplained().size();
  return {by_best == by_other ? left_by_other < left_by_best : by_other < by_best, false};
}

bool takes_the_place(const Left& present, const Left& other) {
  constexpr double clearly = 0.01, hardly = 0.0025, much = 0.25, at_least = 0.1;
  const bool properly = other.proper_score < present.proper_score - clearly && other.heldout <= present.heldout;
  const bool held_out = other.heldout < present.heldout - std::max(at_least, much * (present.heldout - 1)) &&
                        other.proper_score < present.proper_score + hardly;
  return properly || held_out;
}

bool as_good(const Left& present, const Left& other) {
  constexpr double hardly_more = 0.02;
  return other.heldout < present.heldout + hardly_more && std::ranges::includes(present.unexplained, other.unexplained);
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
