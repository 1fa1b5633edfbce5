#include "diagnose/search_result.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double in_common = 0.1;  // cosine of what two effects change, below which each explains its own

/// Where a model bent its parameters to the train captures, those held out show better what it lacks.
bool significant_on_train(const Refined& candidate, const SearchOptions& options) {
  const double gate = std::max(candidate.gate, options.least_train_gain);
  const bool held_out_show_it = candidate.train_gain - candidate.price > options.least_train_gain &&
                                candidate.test_gain > options.beyond_doubt * gate;
  return candidate.share > options.least_share && (candidate.train_gain - candidate.price > gate || held_out_show_it);
}

/// What counts of its gains beside a best one: what that could not prove on the captures held out, where a target may
/// stand wrong without it, counts for neither.
double gain_beside(const Refined& best, const Refined& one) {
  return one.train_gain - one.price + (best.test_gain > 0 ? one.test_gain : 0);
}

bool happens_beyond_doubt(const Refined& candidate, const SearchOptions& options) {
  return candidate.happens_or_not && candidate.shown_on_test > 2 * options.least_test_gain &&
         candidate.linear_gain - candidate.price > options.beyond_doubt * candidate.gate;
}

}  // namespace

std::vector<const Refined*> SearchResult::accepted(const SearchOptions& options) const {
  std::vector<const Refined*> result;
  for (const auto& candidate : refined)
    if (candidate.certain ||
        (candidate.test_gain > options.least_test_gain && significant_on_train(candidate, options)))
      result.push_back(&candidate);
  return result;
}

const Refined* SearchResult::happening(const SearchOptions& options) const {
  // The mean of a capture has more noise than expected where frames are repeated. That looks like a map drawn anew in
  // each capture, of which there may be none.
  const Refined* most = nullptr;
  for (const Refined& candidate : refined)
    if (!candidate.draws && (!most || candidate.linear_gain > most->linear_gain)) most = &candidate;
  return most && happens_beyond_doubt(*most, options) ? most : nullptr;
}

std::vector<const Refined*> SearchResult::unproven(const SearchOptions& options) const {
  std::vector<const Refined*> result;
  for (const auto& candidate : refined) {
    const bool beyond_doubt = candidate.train_gain - candidate.price > options.beyond_doubt * candidate.gate &&
                              significant_on_train(candidate, options);
    const bool fell_otherwise = !significant_on_train(candidate, options) && happens_beyond_doubt(candidate, options);
    if (candidate.shown_on_test > 2 * options.least_test_gain &&
        ((candidate.test_gain <= options.least_test_gain && beyond_doubt) || fell_otherwise))
      result.push_back(&candidate);
  }
  return result;
}

std::vector<const Refined*> SearchResult::unconfirmed(const SearchOptions& options) const {
  std::vector<const Refined*> result;
  for (const auto& candidate : refined)
    if (candidate.test_gain <= options.least_test_gain && candidate.shown_on_test <= 2 * options.least_test_gain &&
        significant_on_train(candidate, options))
      result.push_back(&candidate);
  return result;
}

std::vector<const Refined*> SearchResult::worthy(const SearchOptions& options) const {
  if (const Refined* happens = happening(options)) return {happens};
  const std::vector<const Refined*> proven = accepted(options);
  std::vector<const Refined*> result = unproven(options);
  if (!proven.empty())
    std::erase_if(result, [&](const Refined* candidate) {
      return candidate->train_gain <= options.far_ahead_on_train * proven[0]->train_gain;
    });
  result.insert(result.end(), proven.begin(), proven.end());
  return result;
}

bool SearchResult::explained_by_one(const SearchOptions& options) const {
  const auto most = std::ranges::max_element(refined, {}, &Refined::train_gain);
  return most != refined.end() && significant_on_train(*most, options) && most->share > options.nearly_all &&
         most->test_gain > options.least_test_gain && std::ranges::none_of(refined, [&](const Refined& other) {
           return other.effect != most->effect && other.train_gain > options.next_to_nothing * most->train_gain;
         });
}

bool misplaced(const Rung& rung, const SearchOptions& options) {
  return std::max(rung.train_stated.intrinsics, rung.train_stated.poses) > options.misplaced;
}

bool comes_close(const Refined& best, const Refined& other, const SearchOptions& options) {
  const double close = other.from_given && !best.from_given ? options.close_from_given : options.close_behind;
  return gain_beside(best, other) > close * gain_beside(best, best);
}

bool is_rival(const Refined& best, const Refined& other, const SearchOptions& options) {
  return gain_beside(best, other) > options.rival * gain_beside(best, best);
}

Separation separation(const Rung& rung, const Refined& a, const Refined& b) {
  const auto inner = [&](const Whitened& x, const Whitened& y) {
    return dot(rung.train.apply(x), y) + dot(rung.test.apply(x), y);
  };
  Separation result;
  const double aa = inner(a.change, a.change), bb = inner(b.change, b.change), ab = inner(a.change, b.change);
  result.distance2 = std::max(0.0, aa + bb - 2 * ab);
  result.cosine = aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
  return result;
}

bool moves_the_same(const Rung& rung, const Refined& a, const Refined& b) {
  return (a.draws && b.draws) || std::abs(separation(rung, a, b).cosine) >= in_common;
}

bool confounded(const Rung& rung, const Refined& a, const Refined& b) {
  constexpr double clearly_lost = 0.25;                         // of what the better one gains
  constexpr double by_chance = 9;                               // of chi: three standard deviations
  constexpr double mostly_in_common = std::numbers::sqrt2 / 2;  // half of what they move, squared
  // Were a the truth, b would lose by D +- 2 sqrt(D), D their squared distance; were b the truth it would win by as
  // much. The data decide unless D is within two standard deviations of nothing, or the loss is.
  const double gained = gain_beside(a, a), lost = gained - gain_beside(a, b);
  const Separation s = separation(rung, a, b);
  if (tracing())
    fmt::print(stderr, "  {} over {}: {:.1f}, squared distance {:.1f}, cosine {:.3f}\n", a.effect, b.effect, lost,
               s.distance2, s.cosine);
  // Fits end where depth edges happen to meet the pixels, and the one with more freedom finds the better place. Where
  // signatures, which all stand at the same place, do not clearly say the same, a narrow win proves nothing.
  // Unless the two move nothing in common: then each explains its own, and both are missing.
  if (std::abs(s.cosine) < in_common && lost <= -by_chance) return false;
  const double linear = a.linear_gain - a.price, other_linear = b.linear_gain - b.price;
  const bool views_differ =
      (other_linear > linear && std::abs(s.cosine) >= in_common) ||
      (other_linear > by_chance && other_linear > linear - by_chance && s.cosine > mostly_in_common);
  // And nobody simulates an effect to better than a hundredth of what it does.
  return lost < by_chance || (s.cosine > 0.9 && lost < 2 * std::sqrt(s.distance2)) ||
         (s.cosine > 0.99 && lost < 0.01 * gained) || (views_differ && lost < clearly_lost * gained);
}

std::vector<const Refined*> standing_beside(const Rung& rung, const Refined& best,
                                            const std::vector<const Refined*>& worthy) {
  constexpr double far_behind = 0.25;
  std::vector<const Refined*> result{&best};
  for (const Refined* other : worthy)
    if (other->score() > far_behind * best.score() && std::ranges::all_of(result, [&](const Refined* taken) {
          return taken->effect != other->effect && !moves_the_same(rung, *taken, *other);
        }))
      result.push_back(other);
  result.erase(result.begin());
  return result;
}

}  // namespace binrig
