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
#include "diagnose/look_alikes.h"
#include "diagnose/mask_fit.h"
#include "diagnose/score.h"
#include "diagnose/settle.h"
#include "diagnose/superfluous.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int most_tries = 3;  // of hypotheses one after the other, as long as none makes the ladder better

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
        contest_(experiment, adding_, candidates_, search_options_),
        look_alikes_(experiment, motions, measured, adding_, candidates_, search_options_, climbed_,
                     [this](Rung& rung, const RungOptions& fit) { finish(rung, fit); }) {
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
      book_.reset(), book_as_given_.reset(), looked_closely_.clear(), waiting_.clear();
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
      look_alikes_.forget();
      while (!full() && step_up()) {
      }
      look_alikes_.two_for_one(full);
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
    if (!climb(found.refined, std::move(next), options,
               {unproven, by_its_map, found.refined.happens_or_not, found.refined.draws}))
      return false;
    leave_behind(climbed_.rungs[climbed_.rungs.size() - 2]);
    climbed_.options = options;
    climbed_.candidates.push_back(found.report);
    climbed_.evidence.accepted.push_back(found.accepted);
    climbed_.added.push_back(found.refined.effect);
    look_alikes_.added(found);
    return true;
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

  /// Puts a rung on the ladder; false, and the ladder as it was, if that makes it no better. The gain was computed with
  /// the scale of the rung before; the ladder judges by the last one's.
  bool climb(const Refined& best, Rung next, const RungOptions& options, const Addition& addition) {
    climbed_.rungs.push_back(std::move(next));
    const Rung& before_it = climbed_.rungs[climbed_.rungs.size() - 2];
    Rung& with = climbed_.rungs.back();
    Left before, after;
    const auto improves = [&] {
      std::tie(before, after) = left_by(experiment_.layout(), motions_, measured_.all, before_it, with, addition.draws);
      if (tracing())
        fmt::print(stderr,
                   "  {} added: held-out {:.4f} ({:.4f}) -> {:.4f} ({:.4f}), proper {:.4f} -> {:.4f}, left: {}\n",
                   best.effect, before.heldout, before.statistics, after.heldout, after.statistics, before.proper_score,
                   after.proper_score, fmt::join(after.unexplained | std::views::keys, ", "));
      return makes_better(before, after, addition);
    };
    if (improves()) return true;
    // What is weak hardly bent the others: beginning anew may have cost more than it gains.
    with = adding_.to(before_it, best, climbed_.options, false);
    if (improves()) return true;
    // Nor do masks come back to where they were: by more than it gains, if it acts in few captures.
    with = made_anew(experiment_, motions_, measured_, with_values_of(before_it.model, with.model), with.offsets,
                     options, with.fit.parameters);
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
  std::vector<Found> waiting_;               // best first
  Climbed climbed_;
  LookAlikes look_alikes_;
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
