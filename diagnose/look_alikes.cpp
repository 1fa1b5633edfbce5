#include "diagnose/look_alikes.h"

#include <algorithm>
#include <cmath>
#include <ranges>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnose/rung.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {

std::pair<Left, Left> left_by(const Layout& layout, const std::vector<SceneMotion>& motions, const StatVector& data,
                              const Rung& one, const Rung& next, bool draws) {
  const auto judged = scores(layout, motions, next, data, {&one, &next});
  const auto of = [&](const Score& score, const Rung& rung) {
    const double proper = draws ? proper_score_without_floor_of_bias(layout, rung) : proper_score(layout, rung);
    return Left{score.heldout, proper, unexplained(layout, rung), score.statistics};
  };
  return {of(judged[0], one), of(judged[1], next)};
}

void LookAlikes::added(const Found& found) {
  others_.push_back({found.refined, found.others});
  for (std::size_t k = 0; k + 1 < others_.size() && last().dispersion <= leaves_little; ++k)
    for (const Refined& other : others_[k].others)
      if ((named_beside(k, other.effect) || overlaps(other, k, found.refined)) && take_one_for_two(k, other)) return;
  for (std::size_t k = 0; k + 1 < others_.size(); ++k) {
    if (std::exchange(others_[k].had_their_turn, true)) continue;
    const double close = options_.close_behind * others_[k].added.train_gain;
    for (const Refined& other : std::vector<Refined>(others_[k].others))
      if (other.train_gain > close) exchange(k, other);
  }
}

void LookAlikes::two_for_one(const std::function<bool()>& full) {
  for (std::size_t k = 0; k < others_.size() && last().dispersion <= leaves_little && !full(); ++k) take_two_for_one(k);
}

/// Of these effects' parameters (ids) among the nuisances of the last rung.
std::vector<int> LookAlikes::places_of(const std::vector<std::string>& ids) const {
  std::vector<int> places;
  for (std::size_t p = 0; p < last().fit.parameters.size(); ++p)
    if (std::ranges::find(ids, last().fit.parameters[p].id) != ids.end())
      places.push_back(static_cast<int>(motions_.size() + p));
  return places;
}

/// Does another than candidate k move something in common with what was added later (cosine of at least 0.1), poses,
/// lens and all parameters but those of these marginalised?
bool LookAlikes::overlaps(const Refined& other, std::size_t k, const Refined& later) const {
  constexpr double least = 0.1;
  const Metric metric = last().train.with_held(places_of({climbed_.candidates[k].id, later.id}));
  const Whitened &one = other.change, &two = later.change, seen = metric.apply(one);
  const double cosine = dot(seen, two) / std::sqrt(dot(seen, one) * dot(metric.apply(two), two));
  if (tracing()) fmt::print(stderr, "  {} moves what {} does by {:.2f}\n", later.effect, other.effect, cosine);
  return std::abs(cosine) >= least;
}

/// Is it said of candidate k that the data cannot tell it from this effect?
bool LookAlikes::named_beside(std::size_t k, const std::string& effect) const {
  const auto& rivals = climbed_.evidence.accepted[k].rivals;
  return std::ranges::find(rivals, effect) != rivals.end();
}

bool LookAlikes::is_added(const std::string& effect) const {
  const auto& added = climbed_.evidence.accepted;
  return std::ranges::find(added, effect, &Evidence::Accepted::effect) != added.end();
}

/// `others` in the place of some that were added (ids).
LookAlikes::InPlace LookAlikes::in_place_of(const std::vector<std::string>& ids,
                                            const std::vector<Refined>& others) const {
  const Rung& rung = climbed_.rungs.back();
  InPlace result{others, climbed_.options, {}, {}, {}};
  SensorModel model = rung.model;
  for (const std::string& id : ids) model = without_effect(model, id);
  for (Refined& added : result.added) {
    EffectInstance& instance = add_effect(model, catalogue_, added.effect);
    instance.values = added.model.find(added.id)->values;
    added.id = instance.id;
  }
  for (Refined& added : result.added) {
    added.model = model;
    // What moves the same leaves all else where it is.
    Adding::hold(added, result.options);
  }
  result.rung = adding_.to(rung, result.added.front(), result.options, false);
  finish_(result.rung, result.options);
  std::tie(result.before, result.after) =
      left_by(experiment_.layout(), motions_, measured_.all, rung, result.rung, false);
  if (tracing())
    fmt::print(stderr, "  {} for {}: held-out {:.4f} -> {:.4f}, proper {:.4f} -> {:.4f}, left: {} -> {}\n",
               fmt::join(others | std::views::transform(&Refined::effect), " and "), fmt::join(ids, " and "),
               result.before.heldout, result.after.heldout, result.before.proper_score, result.after.proper_score,
               result.before.unexplained.size(), result.after.unexplained.size());
  return result;
}

/// Puts it on the ladder, as candidate k; `gone`: what it takes the place of, in words.
void LookAlikes::put_in_place(std::size_t k, InPlace in_place, const std::string& gone) {
  const Refined& added = in_place.added.front();
  climbed_.options = in_place.options;
  leave_behind(climbed_.rungs.back());
  climbed_.rungs.push_back(std::move(in_place.rung));
  climbed_.added.push_back(added.effect);
  climbed_.removed.resize(climbed_.rungs.size());
  climbed_.removed.back() = gone;
  climbed_.candidates[k] = candidates_.report_of(added, climbed_.candidates[k].null_count);
  climbed_.evidence.accepted[k] = candidates_.accepted(added);
}

/// A wrong one of two that move the same leaves something that a third makes up for: candidate k and the last one may
/// be one effect, if that leaves no more. False if not.
bool LookAlikes::take_one_for_two(std::size_t k, const Refined& other) {
  if (is_added(other.effect)) return false;
  const CandidateReport &first = climbed_.candidates[k], &second = climbed_.candidates.back();
  InPlace one = in_place_of({first.id, second.id}, {other});
  if (!does_for_two(one.before, one.after)) return false;
  put_in_place(k, std::move(one), first.effect + " and " + second.effect);
  climbed_.candidates.pop_back();
  climbed_.evidence.accepted.pop_back();
  others_.pop_back();
  others_[k] = {other, {}, true};
  return true;
}

/// The two of those that explained much of the same as candidate k which together move most of what it does, if they
/// have fewer parameters than it; none if they leave a tenth of that.
std::vector<Refined> LookAlikes::simpler_two(std::size_t k) const {
  constexpr double nearly_all = 0.9, one_and_the_same = 0.999;  // squares of cosines
  const auto& [whole, others, ignored] = others_[k];
  if (others.size() < 2) return {};
  const auto parameters = [](const Refined& refined) { return refined.fit.parameters.size(); };
  const Metric metric = last().train.with_held(places_of({climbed_.candidates[k].id}));
  const Whitened seen = metric.apply(whole.change);
  const double all = dot(seen, whole.change);
  double most = nearly_all;
  std::vector<Refined> best;
  for (std::size_t a = 0; a < others.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) {
      if (parameters(others[a]) + parameters(others[b]) >= parameters(whole)) continue;
      const Whitened by_a = metric.apply(others[a].change), by_b = metric.apply(others[b].change);
      const double aa = dot(by_a, others[a].change), ab = dot(by_a, others[b].change), bb = dot(by_b, others[b].change),
                   a_all = dot(by_a, whole.change), b_all = dot(by_b, whole.change);
      if (ab * ab > one_and_the_same * aa * bb) continue;
      const double share =
          (bb * a_all * a_all - 2 * ab * a_all * b_all + aa * b_all * b_all) / ((aa * bb - ab * ab) * all);
      if (tracing())
        fmt::print(stderr, "  {} and {} move {:.4f} of what {} does\n", others[a].effect, others[b].effect, share,
                   whole.effect);
      if (share > most) most = share, best = {others[b], others[a]};
    }
  return best;
}

/// Two effects of one parameter each can look like one of three. Where they do what candidate k does, and the
/// captures held out are nearer to them, they take its place, one after the other; the first is said to be confounded
/// with it.
void LookAlikes::take_two_for_one(std::size_t k) {
  const std::vector<Refined> two = simpler_two(k);
  if (two.empty() || is_added(two[0].effect) || is_added(two[1].effect)) return;
  const CandidateReport whole = climbed_.candidates[k];
  InPlace both = in_place_of({whole.id}, two);
  if (!two_do_better(both.before, both.after)) return;
  CandidateReport first = candidates_.report_of(both.added[0], whole.null_count);
  first.confounded_with = {whole.effect};
  candidates_.seek_captures(first, last(), {both.rung.model, first.id, both.rung.fit},
                            {{last().model, whole.id, last().fit}});
  put_in_place(k, in_place_of({whole.id}, {two[0]}), whole.effect);
  climbed_.candidates[k] = first;
  climbed_.evidence.accepted[k].rivals = first.confounded_with;
  others_[k] = {both.added[0], {}, true};
  const Refined& second = both.added[1];
  leave_behind(climbed_.rungs.back());
  climbed_.rungs.push_back(std::move(both.rung));
  climbed_.added.push_back(second.effect);
  climbed_.options = both.options;
  climbed_.candidates.push_back(candidates_.report_of(second, whole.null_count));
  climbed_.evidence.accepted.push_back(candidates_.accepted(second));
  others_.push_back({second, {}, true});
}

/// What was missing elsewhere may have favoured the wrong one of two that explain the same: with what was added
/// since, the other takes the place of candidate k if less is left with it.
void LookAlikes::exchange(std::size_t k, const Refined& other) {
  if (is_added(other.effect)) return;
  CandidateReport& candidate = climbed_.candidates[k];
  const Rung& rung = last();
  auto& rivals = climbed_.evidence.accepted[k].rivals;
  const bool named = named_beside(k, other.effect);
  if (named && unexplained(experiment_.layout(), rung).empty()) return;  // there is nothing that it could do better
  InPlace instead = in_place_of({candidate.id}, {other});
  if (takes_the_place(instead.before, instead.after)) {
    // It was fitted when more was missing: fitted anew it may be as good.
    InPlace anew = in_place_of({candidate.id}, {others_[k].added});
    if (!takes_the_place(anew.after, instead.after)) {
      auto beside = rivals;
      if (!named && as_good(anew.after, instead.after)) beside.push_back(other.effect);
      put_in_place(k, std::move(anew), "its first fit");
      rivals = candidate.confounded_with = std::move(beside);
      return;
    }
    put_in_place(k, std::move(instead), candidate.effect);
    others_[k] = {other, {}, true};
    return;
  }
  if (!as_good(instead.before, instead.after) || named) return;
  rivals.push_back(other.effect);
  candidate.confounded_with = rivals;
  if (rivals.size() == 1)
    candidates_.seek_captures(candidate, rung, {rung.model, candidate.id, rung.fit},
                              {{instead.rung.model, instead.added.front().id, instead.rung.fit}});
}

}  // namespace binrig
