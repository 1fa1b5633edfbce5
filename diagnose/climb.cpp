#include "diagnose/climb.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <ranges>
#include <set>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnose/adding.h"
#include "diagnose/candidates.h"
#include "diagnose/choice.h"
#include "diagnose/contest.h"
#include "diagnose/edge_registration.h"
#include "diagnose/mask_fit.h"
#include "diagnose/score.h"
#include "diagnose/settle.h"
#include "diagnose/superfluous.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double leaves_little = 1.3;  // dispersion up to which places, masks and look-alikes are looked after
constexpr int most_tries = 3;          // of hypotheses one after the other, as long as none makes the ladder better

class Climb {
 public:
  Climb(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
        const SensorModel& model, const Hypotheses& all, const DiagnosisOptions& options)
      : experiment_(experiment),
        motions_(motions),
        measured_(measured),
        given_(model),
        all_(all),
        most_effects_(options.most_effects),
        seed_(options.seed),
        catalogue_(experiment.forward().catalogue()),
        adding_(experiment, motions, measured, model, options.seed),
        candidates_(experiment, motions, all, search_options_, options.seed),
        contest_(experiment, adding_, candidates_, search_options_) {
    climbed_.options.simulations = options.simulations;
    climbed_.options.converged_far_off = 0.01;
    climbed_.options.seed = options.seed * 100000;
  }

  Climbed run() {
    const Climbed nothing = climbed_;
    Rung first = fit_rung(experiment_, motions_, measured_, given_, {}, climbed_.options);
    finish(first, climbed_.options);
    const Layout& layout = experiment_.layout();
    if (const auto bent = parameters_bent(first, given_, search_options_.bent);
        !bent.empty() && needlessly_random(layout, first)) {
      // What happens at random can be made of a mask of which the border lies everywhere and anew in each frame.
      climbed_.options.fixed = bent;
      climb_from(fit_rung(experiment_, motions_, measured_, given_, {}, climbed_.options));
      if (!climbed_.evidence.accepted.empty() &&
          proper_score(layout, climbed_.rungs.back()) < proper_score(layout, first) - clearly_lower) {
        climbed_.warnings.push_back(
            fmt::format("{} stayed as given: fitted alone, they made the model far more random than the recording",
                        fmt::join(bent, ", ")));
        return std::move(climbed_);
      }
      climbed_ = nothing;
      book_.reset(), book_as_given_.reset(), looked_closely_.clear(), waiting_.clear(), others_.clear();
      looked_in_vain_ = step_failed_ = false;
      closely_at_ = std::numeric_limits<double>::infinity(), no_map_at_.clear();
    }
    climb_from(std::move(first));
    return std::move(climbed_);
  }

 private:
  void climb_from(Rung start) {
    climbed_.rungs.push_back(std::move(start));
    climbed_.added.push_back("");
    // A fit that went astray says nothing of how strong the noise is.
    const Rung& first = climbed_.rungs[0];
    if (tracing())
      fmt::print(stderr, "bent: {}\n", fmt::join(parameters_bent(first, given_, search_options_.bent), ", "));
    const SensorModel& near = first.dispersion > search_options_.astray ? given_ : first.model;
    book_.emplace(experiment_, signature_model(given_, near, catalogue_), all_, SignatureOptions{.seed = seed_ * 7001});
    book_->look_at(everyone(), false);
    const auto full = [&] { return static_cast<int>(climbed_.evidence.accepted.size()) >= most_effects_; };
    do {
      others_.assign(climbed_.candidates.size(), {});
      while (!full() && step_up()) {
      }
      for (std::size_t k = 0; k < others_.size() && !full(); ++k) take_two_for_one(k);
      climbed_.as_many_as_allowed = full();
      climbed_.removed.resize(climbed_.rungs.size());
    } while (take_out_superfluous(experiment_, motions_, measured_, climbed_));
  }

  /// Where what is missing bent a parameter, signatures about the bent one hide what it stands in for.
  const SignatureBook& book_from_given() {
    const Rung& first = climbed_.rungs[0];
    const bool about_given = first.dispersion > search_options_.astray;
    if (about_given || !bent(first)) return *book_;
    if (!book_as_given_) {
      book_as_given_.emplace(experiment_, given_, all_, SignatureOptions{.seed = seed_ * 7001});
      book_as_given_->look_at(everyone(), false);
    }
    return *book_as_given_;
  }

  bool bent(const Rung& rung) const { return !parameters_bent(rung, given_, search_options_.bent).empty(); }

  std::vector<int> everyone() const {
    std::vector<int> result(all_.tested.size());
    std::iota(result.begin(), result.end(), 0);
    return result;
  }

  /// Where little is left, or in few captures, what is left may be the place of a target; a mask in the wrong valley or
  /// a fit that stopped half-way, where it is little.
  void finish(Rung& rung, const RungOptions& options) const {
    const auto leaves_much = [&] { return rung.dispersion > leaves_little; };
    if (leaves_much() &&
        2 * captures_that_stand_out(experiment_.layout(), rung).size() >= experiment_.captures().size())
      return;
    register_by_edges(experiment_, motions_, measured_, options, rung);
    if (leaves_much()) return;
    fit_masks(experiment_, motions_, measured_, given_, options, rung);
    if (rung.dispersion <= leaves_something) settle_down(experiment_, motions_, measured_, options, rung);
  }

  /// The last rung's model with the parameters that it was given, what was added where it was fitted.
  Beginning beginning() {
    const SignatureBook& book = book_from_given();
    if (climbed_.evidence.accepted.empty()) return {book.model(), book.signatures(), book.simulations()};
    SensorModel model = with_values_of(book.model(), climbed_.rungs.back().model);
    std::vector<StatVector> simulations = book.simulations_of(model);
    return {std::move(model), left(book).second, std::move(simulations)};
  }

  /// What the rung's model still lacks: hypotheses and their signatures in a book.
  std::pair<Hypotheses, std::vector<Signature>> left(const SignatureBook& book) const {
    std::pair<Hypotheses, std::vector<Signature>> result;
    std::vector<int> index(all_.tested.size(), -1);
    for (std::size_t h = 0; h < all_.tested.size(); ++h) {
      if (std::find(climbed_.added.begin(), climbed_.added.end(), all_.tested[h].effect) != climbed_.added.end())
        continue;
      index[h] = static_cast<int>(result.first.tested.size());
      result.first.tested.push_back(all_.tested[h]);
    }
    for (const auto& signature : book.signatures()) {
      if (index[signature.hypothesis] < 0) continue;
      result.second.push_back(signature);
      result.second.back().hypothesis = index[signature.hypothesis];
    }
    return result;
  }

  /// Simulates more settings of the hypotheses that explain something already.
  void look_closer(const Rung& rung) {
    constexpr double something = 6;  // gain of chi: a fifth of what is needed to be accepted
    looked_closely_.resize(all_.tested.size());
    std::vector<int> worth_it;
    const Ranking ranking(experiment_, rung, all_, book_->signatures());
    for (const LinearGain& found : ranking.gains(rung.rest, rung.nuisances)) {
      const int h = found.hypothesis;
      if (looked_closely_[h] || found.gain < something * rung.dispersion) continue;
      looked_closely_[h] = true;
      worth_it.push_back(h);
    }
    book_->look_at(worth_it, true);
  }

  /// Until the ladder grows, even if it shrinks again: that moves all rungs.
  const Rung& last() const { return climbed_.rungs.back(); }

  /// Adds the best hypothesis and fits everything again; false if there is none, or if it lowers no held-out score.
  bool step_up() {
    // What was not found beside so much else may be found when half of that is explained, or all that can be.
    const auto as_much_is_left = [&](double dispersion) {
      return last().dispersion > far_off && 2 * last().dispersion > dispersion;
    };
    std::erase_if(no_map_at_, [&](const auto& entry) { return !as_much_is_left(entry.second); });
    const bool closely = !as_much_is_left(closely_at_), at_all = closely && no_map_at_.empty();
    if (step(closely)) return true;
    no_map_at_.clear();
    return !at_all && step(true);
  }

  /// The same at the rung as it stands; `closely`: see Standing.
  bool step(bool closely) {
    if (take_waiting()) return true;
    look_closer(last());
    const auto [hypotheses, signatures] = left(*book_);
    Standing standing{!climbed_.evidence.accepted.empty(), bent(last()), looked_in_vain_, !step_failed_, closely, {}};
    for (const auto& [effect, dispersion] : no_map_at_) standing.no_maps.insert(effect);
    const SearchResult found = search(
        experiment_, motions_, last(), measured_, hypotheses, signatures, standing, [this] { return beginning(); },
        search_options_);
    for (const std::string& effect : found.no_maps) no_map_at_.try_emplace(effect, last().dispersion);
    if (found.looked_closely) closely_at_ = last().dispersion;
    if (climbed_.ranking.empty())
      for (std::size_t h = 0; h < hypotheses.tested.size(); ++h)
        climbed_.ranking.push_back({hypotheses.tested[h].effect, found.linear[h].gain / last().dispersion,
                                    found.prices[h], found.p_values[h]});
    if (tracing()) {
      fmt::print(stderr, "step {} gate {:.1f} dispersion {:.2f}\n", climbed_.rungs.size() - 1, found.gate,
                 last().dispersion);
      for (const auto& r : found.refined)
        fmt::print(stderr, "  {} linear {:.1f} price {:.1f} gate {:.1f} train {:.1f} test {:.1f} share {:.3f}\n",
                   r.effect, r.linear_gain, r.price, r.gate, r.train_gain, r.test_gain, r.share);
    }
    climbed_.unconfirmed.clear();
    for (const Refined* candidate : found.unconfirmed(search_options_))
      climbed_.unconfirmed.push_back({candidate->effect, capture_name(experiment_, candidate->shown_in)});
    auto proven = found.accepted(search_options_), worthy = found.worthy(search_options_);
    const bool beside_proven = !proven.empty() && worthy.size() > proven.size();
    say(candidates_.leave_trifles(last(), worthy));
    std::set<const Refined*> failed;
    const auto take_best_of = [&](std::vector<const Refined*> of) {
      std::erase_if(of, [&](const Refined* candidate) { return failed.contains(candidate); });
      for (int tries = 0; tries < most_tries && !of.empty(); ++tries) {
        const Rung& rung = last();
        auto [best, next, beaten] = contest_.decide(rung, of, signatures, climbed_.options);
        // Where many are missing, each of these explains its own: they wait, and nothing is looked for in between.
        if (rung.dispersion > many_missing)
          for (const Refined* other : standing_beside(rung, *best, of))
            waiting_.push_back(candidates_.of(*other, rung, found));
        const bool unproven = std::ranges::find(proven, best) == proven.end();
        if (found.looked_again) looked_in_vain_ = !best->from_given;
        if (take(candidates_.of(*best, rung, found, beaten), std::move(next), unproven)) return true;
        failed.insert(best);
        // Where little is left, what makes it no better was a chance resemblance, and so are those behind it.
        const bool little = last().dispersion <= leaves_little && !misplaced(last(), search_options_);
        if (little || !waiting_.empty()) return false;
        std::erase_if(of, [&, effect = best->effect](const Refined* other) { return other->effect == effect; });
      }
      return false;
    };
    if (take_best_of(worthy) || take_waiting()) return true;
    if (std::ranges::any_of(found.refined, &Refined::certain)) {  // nothing else was looked for
      step_failed_ = true;
      return step(closely);
    }
    // Where what proved itself made nothing better, what could not is left, if there is anything to explain.
    std::vector<const Refined*> others;
    if (beside_proven)
      others = proven;
    else if (!proven.empty() && !unexplained(experiment_.layout(), last()).empty())
      others = found.unproven(search_options_);
    if (others.empty()) return false;
    say(candidates_.leave_trifles(last(), others));
    return take_best_of(others) || take_waiting();
  }

  void say(const std::string& warning) {
    if (!warning.empty()) climbed_.warnings.push_back(warning);
  }

  /// Puts what was found on the ladder with its rung; false if that makes it no better.
  bool take(const Found& found, Rung next, bool unproven) {
    RungOptions options = climbed_.options;
    Adding::hold(found.refined, options);
    finish(next, options);
    const bool by_its_map = found.accepted.map && found.accepted.map_looks_random;
    if (!climb(found.refined, std::move(next),
               {unproven, by_its_map, found.refined.happens_or_not, found.refined.draws}))
      return false;
    leave_behind(climbed_.rungs[climbed_.rungs.size() - 2]);
    climbed_.options = options;
    climbed_.candidates.push_back(found.report);
    climbed_.evidence.accepted.push_back(found.accepted);
    climbed_.added.push_back(found.refined.effect);
    others_.push_back({found.refined, found.others});
    for (std::size_t k = 0; k + 1 < others_.size() && last().dispersion <= leaves_little; ++k)
      for (const Refined& other : others_[k].others)
        if ((named_beside(k, other.effect) || overlaps(other, k, found.refined)) && take_one_for_two(k, other))
          return true;
    for (std::size_t k = 0; k + 1 < others_.size(); ++k) {
      if (std::exchange(others_[k].had_their_turn, true)) continue;
      const double close = search_options_.close_behind * others_[k].added.train_gain;
      for (const Refined& other : std::vector<Refined>(others_[k].others))
        if (other.train_gain > close) exchange(k, other);
    }
    return true;
  }

  /// Of these effects' parameters (ids) among the nuisances of the last rung.
  std::vector<int> places_of(const std::vector<std::string>& ids) const {
    std::vector<int> places;
    for (std::size_t p = 0; p < last().fit.parameters.size(); ++p)
      if (std::ranges::find(ids, last().fit.parameters[p].id) != ids.end())
        places.push_back(static_cast<int>(motions_.size() + p));
    return places;
  }

  /// Does another than candidate k move something in common with what was added later (cosine of at least 0.1), poses,
  /// lens and all parameters but those of these marginalised?
  bool overlaps(const Refined& other, std::size_t k, const Refined& later) const {
    constexpr double least = 0.1;
    const Metric metric = last().train.with_held(places_of({climbed_.candidates[k].id, later.id}));
    const Whitened &one = other.change, &two = later.change, seen = metric.apply(one);
    const double cosine = dot(seen, two) / std::sqrt(dot(seen, one) * dot(metric.apply(two), two));
    if (tracing()) fmt::print(stderr, "  {} moves what {} does by {:.2f}\n", later.effect, other.effect, cosine);
    return std::abs(cosine) >= least;
  }

  /// Is it said of candidate k that the data cannot tell it from this effect?
  bool named_beside(std::size_t k, const std::string& effect) const {
    const auto& rivals = climbed_.evidence.accepted[k].rivals;
    return std::ranges::find(rivals, effect) != rivals.end();
  }

  bool is_added(const std::string& effect) const {
    const auto& added = climbed_.evidence.accepted;
    return std::ranges::find(added, effect, &Evidence::Accepted::effect) != added.end();
  }

  /// The last rung's model with `other` in the place of some that were added (ids), everything fitted again.
  struct InPlace {
    std::vector<Refined> added;
    RungOptions options;
    Rung rung;
    Left before, after;
  };
  InPlace in_place_of(const std::vector<std::string>& ids, const std::vector<Refined>& others) const {
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
    finish(result.rung, result.options);
    std::tie(result.before, result.after) = left_by(rung, result.rung, false);
    if (tracing())
      fmt::print(stderr, "  {} for {}: held-out {:.4f} -> {:.4f}, proper {:.4f} -> {:.4f}, left: {} -> {}\n",
                 fmt::join(others | std::views::transform(&Refined::effect), " and "), fmt::join(ids, " and "),
                 result.before.heldout, result.after.heldout, result.before.proper_score, result.after.proper_score,
                 result.before.unexplained.size(), result.after.unexplained.size());
    return result;
  }

  /// Puts it on the ladder, as candidate k; `gone`: what it takes the place of, in words.
  void put_in_place(std::size_t k, InPlace in_place, const std::string& gone) {
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
  bool take_one_for_two(std::size_t k, const Refined& other) {
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
  std::vector<Refined> simpler_two(std::size_t k) const {
    constexpr double nearly_all = 0.9;
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
        const double aa = dot(by_a, others[a].change), ab = dot(by_a, others[b].change),
                     bb = dot(by_b, others[b].change), a_all = dot(by_a, whole.change), b_all = dot(by_b, whole.change);
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
  void take_two_for_one(std::size_t k) {
    if (last().dispersion > leaves_little) return;
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
  void exchange(std::size_t k, const Refined& other) {
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

  /// Adds the first of those waiting that still makes the ladder better; false if none does.
  bool take_waiting() {
    while (!waiting_.empty()) {
      Found found = std::move(waiting_.front());
      waiting_.erase(waiting_.begin());
      const Rung& rung = last();
      SensorModel model = rung.model;
      add_effect(model, catalogue_, found.refined.effect).values = found.refined.model.find(found.refined.id)->values;
      found.refined.model = std::move(model);
      if (take(found, adding_.to(rung, found.refined, climbed_.options), false)) return true;
    }
    return false;
  }

  /// What two models leave that come one after the other, the second one's randomness being the scale. `draws`: see
  /// Addition.
  std::pair<Left, Left> left_by(const Rung& one, const Rung& next, bool draws) const {
    const Layout& layout = experiment_.layout();
    const auto judged = scores(layout, motions_, next, measured_.all, {&one, &next});
    const auto of = [&](const Score& score, const Rung& rung) {
      const double proper = draws ? proper_score_without_floor_of_bias(layout, rung) : proper_score(layout, rung);
      return Left{score.heldout, proper, unexplained(layout, rung), score.statistics};
    };
    return {of(judged[0], one), of(judged[1], next)};
  }

  /// Puts a rung on the ladder; false, and the ladder as it was, if that makes it no better. The gain was computed with
  /// the scale of the rung before; the ladder judges by the last one's.
  bool climb(const Refined& best, Rung next, const Addition& addition) {
    climbed_.rungs.push_back(std::move(next));
    Left before, after;
    const auto improves = [&] {
      std::tie(before, after) =
          left_by(climbed_.rungs[climbed_.rungs.size() - 2], climbed_.rungs.back(), addition.draws);
      if (tracing())
        fmt::print(stderr,
                   "  {} added: held-out {:.4f} ({:.4f}) -> {:.4f} ({:.4f}), proper {:.4f} -> {:.4f}, left: {}\n",
                   best.effect, before.heldout, before.statistics, after.heldout, after.statistics, before.proper_score,
                   after.proper_score, fmt::join(after.unexplained | std::views::keys, ", "));
      return makes_better(before, after, addition);
    };
    if (improves()) return true;
    // What is weak hardly bent the others: beginning anew may have cost more than it gains.
    climbed_.rungs.back() = adding_.to(climbed_.rungs[climbed_.rungs.size() - 2], best, climbed_.options, false);
    if (improves()) return true;
    const char* how = after.heldout >= before.heldout             ? "did not fall"
                      : after.proper_score >= before.proper_score ? "fell, but the proper score rose"
                                                                  : "fell by too little";
    climbed_.warnings.push_back(
        fmt::format("{} was tried next and taken out again: with it the error on captures held out {} "
                    "({:.3g} to {:.3g}; proper score {:.4g} to {:.4g})",
                    best.effect, how, before.heldout, after.heldout, before.proper_score, after.proper_score));
    climbed_.rungs.pop_back();
    return false;
  }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Measurement& measured_;
  const SensorModel& given_;
  const Hypotheses& all_;
  const int most_effects_;
  const std::uint64_t seed_;
  const EffectCatalogue& catalogue_;
  const SearchOptions search_options_;
  const Adding adding_;
  const Candidates candidates_;
  const Contest contest_;
  std::optional<SignatureBook> book_, book_as_given_;
  std::vector<bool> looked_closely_;  // by hypothesis
  bool looked_in_vain_ = false;       // see Standing
  bool step_failed_ = false;          // one that is certain made nothing better
  double closely_at_ = std::numeric_limits<double>::infinity();  // dispersion, when waves were last looked for closely
  std::map<std::string, double> no_map_at_;  // the same, by effect, when its map did not look random
  std::vector<Found> waiting_;        // best first
  struct Others {
    Refined added;
    std::vector<Refined> others;  ///< that explained much of the same
    bool had_their_turn = false;  ///< to take its place
  };
  std::vector<Others> others_;  // by candidate
  Climbed climbed_;
};

}  // namespace

std::string capture_name(const Experiment& experiment, int capture) {
  return experiment.captures()[capture].key() + " " + experiment.captures()[capture].name;
}

Climbed climb(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
              const SensorModel& model, const Hypotheses& all, const DiagnosisOptions& options) {
  return Climb(experiment, motions, measured, model, all, options).run();
}

}  // namespace binrig
