#include "diagnose/search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include "core/error.h"
#include "diagnose/anew.h"
#include "diagnose/close_look.h"
#include "diagnose/happening.h"
#include "diagnose/map_hypotheses.h"
#include "diagnose/score.h"
#include "diagnose/spot.h"
#include "diagnose/tone.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + static_cast<long>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

class Search {
 public:
  Search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
         const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
         const Standing& standing, const std::function<Beginning()>& beginning, const SearchOptions& options)
      : experiment_(experiment),
        motions_(motions),
        rung_(rung),
        measured_(measured),
        hypotheses_(hypotheses),
        signatures_(signatures),
        standing_(standing),
        beginning_(beginning),
        options_(options),
        refiner_{experiment, motions, rung, measured, options.seeds, options.seed, Part::all, frames_for(rung)},
        count_(static_cast<int>(hypotheses.tested.size())),
        ranking_(experiment, rung, hypotheses, signatures),
        maps_(experiment, rung, measured, hypotheses, standing.no_maps, options.seed + 80),
        left_(rung.dispersion),
        certain_(certain_step()) {}

  SearchResult run() {
    hold_signatures_against_residual();
    set_gates();
    base_ = registered_remainder(refiner_, rung_.model);
    if (certain_) {
      take_certain_step();
      return std::move(result_);
    }
    look_where_it_stands_out();
    refine_shortlist();
    const bool known = result_.explained_by_one(options_) || result_.happening(options_);
    if (made_up_for() || (!known && astray() && !first_of_many()))
      look_again(from_given());
    else if (!known && lines_unexplained())
      look_again(steps_of(beginning_()));
    std::sort(result_.refined.begin(), result_.refined.end(),
              [](const Refined& a, const Refined& b) { return a.score() > b.score(); });
    result_.no_maps = maps_.unlike();
    return std::move(result_);
  }

 private:
  /// The rung's model with a hypothesis where the linear view puts it.
  SensorModel added(int h) const {
    return with_effect(rung_.model, experiment_.forward().catalogue(), hypotheses_.tested[h].effect,
                       result_.linear[h].values);
  }

  /// Gains of all hypotheses, on the data and on recordings in which nothing is missing.
  void hold_signatures_against_residual() {
    result_.linear = ranking_.gains(rung_.rest, rung_.nuisances);
    if (!certain_) maps_.learn(result_.linear);
    result_.null_gains.resize(count_);
    for (const auto& null : rung_.nulls) {
      const Explained explained = rung_.train.explain(null);
      const Whitened& rest = explained.rest;
      auto gains = ranking_.gains(rest, explained.values);
      maps_.add_gains(rest, gains);
      if (const auto spot = spot_left(experiment_, rest)) null_spot_ = std::max(null_spot_, spot->stands_out);
      for (int h = 0; h < count_; ++h) result_.null_gains[h].push_back(gains[h].gain);
    }
    for (int h = 0; h < count_; ++h) {
      const auto& nulls = result_.null_gains[h];
      result_.prices.push_back(std::accumulate(nulls.begin(), nulls.end(), 0.0) / std::max<double>(1, nulls.size()));
      result_.p_values.push_back(gain_p_value(result_.linear[h].gain / rung_.dispersion, nulls));
    }
  }

  /// A few wild simulations of one hypothesis (holes where none of the others has any) must not hide all others: the
  /// common bar is a robust one, and each hypothesis has to clear its own besides. One of which chance makes hardly
  /// anything need not clear what chance makes of others.
  void set_gates() {
    const std::size_t nulls = rung_.nulls.size();
    std::vector<double> best_null(nulls, 0);
    for (int h = 0; h < count_; ++h)
      for (std::size_t k = 0; k < nulls; ++k)
        best_null[k] = std::max(best_null[k], result_.null_gains[h][k] - result_.prices[h]);
    const double middle = quantile(best_null, 0.5);
    result_.gate = middle + 3 * std::max(quantile(best_null, 0.84) - middle, 0.3 * middle);
    for (int h = 0; h < count_; ++h) {
      double square = 0;
      for (double gain : result_.null_gains[h]) square += std::pow(gain - result_.prices[h], 2) / nulls;
      const double own = std::sqrt(square);
      own_gate_.push_back(std::max(3 * own, std::min(result_.gate, options_.least_train_gain + 10 * own)));
    }
  }

  struct Listed {
    double gain;  ///< of chi, before it is fitted
    int hypothesis;
  };
  /// The best by linear gain; where much is unexplained, the linear view of signatures may mislead, and what is left
  /// when they are simulated decides.
  std::vector<Listed> shortlist() {
    std::vector<int> order(count_);
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(),
              [&](int a, int b) { return result_.linear[a].gain > result_.linear[b].gain; });
    if (tracing())
      for (int k = 0; k < std::min(count_, 6); ++k)
        fmt::print(stderr, "  {} gains {:.1f}, price {:.1f}, gate {:.1f}\n", hypotheses_.tested[order[k]].effect,
                   result_.linear[order[k]].gain / rung_.dispersion, result_.prices[order[k]], own_gate_[order[k]]);
    std::vector<Listed> list, doubtful;
    for (int h : order) {
      if (static_cast<int>(list.size()) >= options_.shortlist) break;
      const double gain = result_.linear[h].gain, above_price = gain / rung_.dispersion - result_.prices[h];
      if (above_price >= own_gate_[h])
        list.push_back({gain, h});
      else if (result_.prices[h] < options_.least_train_gain &&  // where chance gains much, fitting it gains more
               above_price >= std::max(options_.least_train_gain, options_.doubtful * own_gate_[h]) &&
               static_cast<int>(doubtful.size()) < options_.doubted)
        doubtful.push_back({gain, h});
    }
    const double worth_a_look = list.empty() || rung_.dispersion <= far_off ? 0 : options_.overtakes * list[0].gain;
    for (const auto* listed : {&list, &doubtful})
      for (const Listed& one : *listed)
        if (one.gain >= worth_a_look && has_place(*hypotheses_.tested[one.hypothesis].declaration))
          look_close_by(one.hypothesis);
    if (rung_.dispersion > options_.linear_until && static_cast<int>(list.size()) > options_.refine) {
      // Signatures stand where the targets nominally do.
      const Refiner trying = on_train(refiner_);
      const double nominal = remainder_of(trying, rung_.model, {}, {}).train;
      for (auto& [gain, h] : list) {
        const double linear = gain;
        const auto simulated = [&] {
          return nominal - remainder_of(trying, added(h), {}, {}).train + maps_.gain(h).train;
        };
        gain = simulated();
        weaken(h, gain, linear, simulated);
        if (!tracing()) continue;
        fmt::print(stderr, "  {} linear {:.0f} simulated {:.0f}:", hypotheses_.tested[h].effect, linear, gain);
        for (const auto& [name, value] : result_.linear[h].values) fmt::print(stderr, " {} {:.4g}", name, value);
        fmt::print(stderr, "\n");
      }
      std::stable_sort(list.begin(), list.end(), [](const Listed& a, const Listed& b) { return a.gain > b.gain; });
      second_listed_ = list[1].gain;
    }
    // What comes close to the best may be what it is confounded with, and is not to go unseen.
    const auto comes_close = [&](const Listed& one) { return one.gain >= options_.rival * list[0].gain; };
    auto end = list.begin() + std::min<std::ptrdiff_t>(list.size(), options_.refine);
    while (end != list.end() && comes_close(*end)) ++end;
    list.erase(end, list.end());
    for (const Listed& one : doubtful)
      if (static_cast<int>(list.size()) < options_.refine) list.push_back(one);
    return list;
  }

  /// Rare events weigh more in stabilised statistics the fewer they are, and what doubles a variance does not double
  /// its logarithm: the linear view goes too far. A hypothesis that disappoints is simulated weaker, too.
  template <typename Simulated>
  void weaken(int h, double& gain, double promised, const Simulated& simulated) {
    constexpr double disappointing = 0.5, weaker = 0.3;
    const EffectDeclaration& effect = *hypotheses_.tested[h].declaration;
    const ParameterSpec* amplitude = effect.parameter(effect.amplitude);
    if (!amplitude || !amplitude->interpolate) return;
    double& value = result_.linear[h].values[amplitude->name];
    for (int k = 0; k < 3 && gain < disappointing * promised; ++k) {
      const double before = value;
      value = std::max(amplitude->lower, weaker * value);
      const double its = simulated();
      if (its <= gain) {
        value = before;
        return;
      }
      gain = its;
    }
  }

  /// A grid of places is too coarse for what is small. Where something stands out in the image that chance does not
  /// make stand out, the effects that have a place are tried there.
  void look_where_it_stands_out() {
    constexpr double clearly = 2;
    const auto spot = spot_left(experiment_, rung_.rest);
    if (!spot || spot->stands_out < clearly * null_spot_) return;
    for (int h = 0; h < count_; ++h) {
      const Hypothesis& hypothesis = hypotheses_.tested[h];
      if (!has_place(*hypothesis.declaration)) continue;
      LinearGain there = result_.linear[h];
      there.values = placed_at(*hypothesis.declaration, there.values, spot->x, spot->y);
      there.gain = 0;
      there = binrig::look_close_by(refiner_, hypothesis, there, signatures_, 1.5 * spot->cell);
      if (there.gain <= result_.linear[h].gain) continue;
      result_.linear[h] = there;
      result_.p_values[h] = gain_p_value(there.gain / rung_.dispersion, result_.null_gains[h]);
      placed_.push_back(h);
    }
  }

  void look_close_by(int h) {
    if (std::ranges::find(placed_, h) != placed_.end()) return;
    const double gain = result_.linear[h].gain;  // by which it was listed; the other is of a few captures
    result_.linear[h] = binrig::look_close_by(refiner_, hypotheses_.tested[h], result_.linear[h], signatures_);
    result_.linear[h].gain = gain;
  }

  /// What a refined hypothesis gains, by simulation; of what a fit `anew` does, only what it owes to the hypothesis.
  void judge(RefinedFit fitted, int h, bool anew = false) {
    Refined refined;
    refined.from_given = result_.looked_again;
    refined.id = fitted.id;
    refined.model = fitted.fit.model;
    refined.fit = std::move(fitted.fit);
    refined.hypothesis = h;
    refined.effect = hypotheses_.tested[h].effect;
    refined.linear_gain = result_.linear[h].gain / rung_.dispersion;
    refined.price = result_.prices[h];
    // Of one that the linear view hardly saw, more is asked.
    const bool doubted = refined.linear_gain - refined.price < own_gate_[h];
    refined.gate = (doubted ? options_.beyond_doubt : 1) * own_gate_[h];
    refined.p = result_.p_values[h];
    refined.draws = hypotheses_.tested[h].declaration->per_capture_map;
    refined.random_map = maps_.looks_random(h);
    std::map<std::string, double> values;
    for (const auto& [name, value] : refined.model.find(refined.id)->values) values[name] = value.value;
    if (const ReadStep* step = hypotheses_.tested[h].seen_at(values)) {
      refined.step_seen = true;
      refined.certain = standing_.exact_steps_first && step->exact;
      if (refined.certain) refined.p = {1e-12, true};  // the least that is said; gains are not what speaks for it
      value_in(refined.model, refined.id, hypotheses_.tested[h].declaration->amplitude).ci95 = {
          {step->value - step->uncertainty, step->value + step->uncertainty}};
    }
    Refiner refiner = refiner_;
    refined.happens_or_not = happens_or_not(*hypotheses_.tested[h].declaration);
    refined.held = maps_.gives_parameters(h) || refined.happens_or_not;
    if (refined.happens_or_not) refiner.seeds *= 4;
    const Remainder with = registered_remainder(refiner, refined.model);
    Remainder base = base_;
    if (anew) {
      Remainder fitted_too = registered_remainder(refiner_, without_effect(refined.model, refined.id));
      if (fitted_too.train < base.train) base = std::move(fitted_too);
    }
    left_ = std::min(left_, rung_.dispersion * with.train / base_.train);
    enter(std::move(refined), base, with);
  }

  /// Where simulations toss for more than it explains, what they agree on decides.
  void judge_tone(int h) {
    Refined& refined = result_.refined.back();
    RefinedFit fitted = refine_tone(refiner_, hypotheses_.tested[h], result_.linear[h]);
    refined.id = fitted.id;
    refined.model = fitted.fit.model;
    refined.fit = std::move(fitted.fit);
    refined.held = true;
    refined.gate = own_gate_[h];
    const ClearRemainders left = clear_remainders(refiner_, refined.model);
    left_ = std::min(left_, rung_.dispersion * left.with.train / left.without.train);
    Refined clear = std::move(refined);
    result_.refined.pop_back();
    enter(std::move(clear), left.without, left.with);
  }

  void enter(Refined refined, const Remainder& base, const Remainder& with) {
    const int h = refined.hypothesis;
    refined.train_gain = (base.train - with.train + maps_.gain(h).train) / rung_.dispersion;
    refined.test_gain = (base.test - with.test + maps_.gain(h).test) / rung_.dispersion;
    // Where it draws something large anew in each recording, much of what is left may be this recording's draw.
    const double gain = refined.train_gain * rung_.dispersion;
    const double excess = base.train * (1 - 1 / rung_.dispersion) - std::max(0.0, with.scatter - base.scatter);
    if (excess > std::max(0.0, gain)) refined.share = gain / excess;
    refined.change = with.mean;
    for (std::size_t i = 0; i < refined.change.size(); ++i) refined.change[i] -= base.mean[i];
    compress(refined.change);
    refined.shown_on_test = dot(rung_.test.apply(refined.change), refined.change) / rung_.dispersion;
    std::vector<double> power(experiment_.layout().captures, 0);
    add_power(experiment_.layout(), rung_.train.apply(refined.change), power);
    refined.shown_in = static_cast<int>(std::max_element(power.begin(), power.end()) - power.begin());
    result_.refined.push_back(std::move(refined));
  }

  /// The rung's model with a hypothesis where the linear view puts it, not fitted.
  RefinedFit as_it_is(int h) const {
    RefinedFit result;
    result.fit.model = rung_.model;
    result.id = add_effect(result.fit.model, experiment_.forward().catalogue(), hypotheses_.tested[h].effect,
                           result_.linear[h].values)
                    .id;
    return result;
  }

  struct CertainStep {
    int hypothesis;
    double step;
  };
  /// A step of which nearly all recorded values are whole multiples is in the recording, whatever else is missing. One
  /// that is wider than the noise is a landscape of stairs in which, with targets where they nominally stand, the right
  /// step leaves as much as none.
  std::optional<CertainStep> certain_step() const {
    for (int h = 0; h < count_ && standing_.exact_steps_first; ++h) {
      double coarsest = 0;  // its whole parts are exact, too
      for (const ReadStep& step : hypotheses_.tested[h].seen)
        if (step.exact) coarsest = std::max(coarsest, step.value);
      if (coarsest > 0) return {{h, coarsest}};
    }
    return {};
  }

  void take_certain_step() {
    const Hypothesis& hypothesis = hypotheses_.tested[certain_->hypothesis];
    LinearGain at = result_.linear[certain_->hypothesis];
    at.values[hypothesis.declaration->amplitude] = certain_->step;
    judge(refine(refiner_, hypothesis, at), certain_->hypothesis);
  }

  void refine_shortlist() {
    double most_explained = 0;
    for (const auto& [gain, h] : shortlist()) {
      // One that explains far less before it is fitted will not be the best when it is.
      const auto& parameters = hypotheses_.tested[h].declaration->parameters;
      const bool to_be_scanned = std::any_of(parameters.begin(), parameters.end(),
                                             [](const ParameterSpec& spec) { return !spec.interpolate; });
      if (gain < (to_be_scanned ? 0.5 : 1) * options_.hopeless * most_explained) continue;
      const Hypothesis& hypothesis = hypotheses_.tested[h];
      if (maps_.gives_parameters(h)) {
        judge(maps_.given_by_map(h, result_.linear[h].values), h);
      } else if (happens_or_not(*hypothesis.declaration)) {
        judge(given_by_signatures(refiner_, hypothesis, result_.linear[h], ranking_), h);
      } else if (maps_.begins_with_draws(h)) {
        judge(as_it_is(h), h);
      } else {
        if (!has_place(*hypothesis.declaration)) look_close_by(h);
        judge(refine(refiner_, hypothesis, result_.linear[h]), h);
        const Refined& fitted = result_.refined.back();
        if (has_tone(*hypothesis.declaration) && rung_.dispersion <= options_.linear_until &&
            fitted.train_gain < options_.disappointing * fitted.linear_gain)
          judge_tone(h);
      }
      // What fails on the captures held out must not keep others from being tried.
      const Refined& refined = result_.refined.back();
      if (refined.test_gain <= options_.least_test_gain) continue;
      // Where little is missing, fitting may gain several times what signatures promise, those of the others, too.
      const double explained = refined.train_gain * rung_.dispersion;
      most_explained =
          std::max(most_explained, rung_.dispersion > options_.linear_until ? explained : std::min(gain, explained));
    }
    look_for_periods(most_explained);
  }

  /// Signatures know a few periods only: what explains nearly all at another one gains next to nothing by them. As long
  /// as so much is left, that one is looked for before anything is called the best.
  void look_for_periods(double most_explained) {
    if (left_ <= options_.unexplained || !standing_.closely || first_of_many()) return;
    result_.looked_closely = true;
    for (int h = 0; h < count_; ++h) {
      const Hypothesis& hypothesis = hypotheses_.tested[h];
      LinearGain& listed = result_.linear[h];
      if (!has_period(*hypothesis.declaration) ||
          std::ranges::any_of(result_.refined, [&](const Refined& refined) { return refined.hypothesis == h; }))
        continue;
      const double least = std::max({listed.gain, options_.hopeless * most_explained,
                                     (result_.prices[h] + own_gate_[h]) * rung_.dispersion});
      const LinearGain close = binrig::look_close_by(refiner_, hypothesis, listed, signatures_, {}, least);
      if (close.gain <= least) continue;
      listed.values = close.values;
      judge(refine(refiner_, hypothesis, listed), h);
    }
  }

  /// Poses, intrinsics or other parameters made up for what is missing, or nobody explains it: what the model leaves
  /// says little of what it lacks. Signatures are of the model without what was added to it: with that, less says so.
  bool astray() const {
    const bool proven = !result_.accepted(options_).empty();
    if (misplaced(rung_, options_)) return !proven || !standing_.looked_in_vain;
    if (!standing_.added && standing_.bent) return true;
    if (!proven) return left_ > options_.unexplained || !unexplained(experiment_.layout(), rung_).empty();
    return !standing_.added && left_ > options_.astray;
  }

  /// With what was added, a parameter went so far that hardly anything is left: what is accepted now may be no more
  /// than what it did not make up for.
  bool made_up_for() const {
    return standing_.added && standing_.bent && rung_.dispersion <= leaves_something && !standing_.looked_in_vain &&
           !result_.accepted(options_).empty();
  }

  /// So much is left by one that explains so much more than all others that several are missing: it comes first, and
  /// the turn of the others comes with it in the model.
  bool first_of_many() const {
    double most = 0;
    for (const Refined& refined : result_.refined) most = std::max(most, refined.train_gain * rung_.dispersion);
    return left_ > many_missing && most > options_.far_ahead * second_listed_;
  }

  /// Beside what was added, waves were looked for just now: where that leaves so much, not once more without.
  Beginning from_given() const {
    Beginning from = beginning_();
    if (standing_.added && rung_.dispersion > far_off)
      std::erase_if(from.signatures,
                    [&](const Signature& s) { return has_period(*hypotheses_.tested[s.hypothesis].declaration); });
    return from;
  }

  /// The recorded values come in steps that the model given does not know. Parameters that were bent to make up for
  /// that blur its lines, and no step explains anything any more.
  bool lines_unexplained() const {
    return !standing_.added && left_ > options_.unexplained &&
           std::ranges::any_of(hypotheses_.tested, [](const Hypothesis& h) { return !h.seen.empty(); });
  }
  Beginning steps_of(Beginning from) const {
    std::erase_if(from.signatures, [&](const Signature& s) { return hypotheses_.tested[s.hypothesis].seen.empty(); });
    return from;
  }

  /// From the parameters as they were given, unless that names the best one of those accepted, too.
  void look_again(const Beginning& from) {
    result_.looked_again = true;
    const auto accepted = result_.accepted(options_);
    const auto best = std::max_element(accepted.begin(), accepted.end(),
                                       [](const Refined* a, const Refined* b) { return a->score() < b->score(); });
    const int known = best == accepted.end() ? -1 : (*best)->hypothesis;
    const double by_chance = rung_.train.explain(rung_.data, rung_.place).chi / rung_.dispersion;
    const double share = options_.least_share * (1 - 1 / rung_.dispersion);  // less than that is not accepted
    // A gain before anything is fitted is no more than a sign; but where much is left, that is enough to show it all.
    const double shown = rung_.dispersion > far_off ? 1 : 0.5;
    std::vector<double> least_share;
    for (const double gate : own_gate_) least_share.push_back(shown * std::max(gate / by_chance, share));
    for (Anew& anew : look_anew(experiment_, motions_, measured_, from, hypotheses_, known, options_.anew,
                                options_.seed + 60, least_share)) {
      // What the rung has learned of all else is worth more than what a fit from far away did, or it went astray.
      LinearGain start = result_.linear[anew.hypothesis];
      for (auto& [name, value] : start.values) value = anew.fit.model.find(anew.id)->value(name);
      judge({anew.id, std::move(anew.fit)}, anew.hypothesis, true);
      judge(refine(refiner_, hypotheses_.tested[anew.hypothesis], start), anew.hypothesis);
    }
  }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const Measurement& measured_;
  const Hypotheses& hypotheses_;
  const std::vector<Signature>& signatures_;
  const Standing& standing_;
  const std::function<Beginning()>& beginning_;
  const SearchOptions& options_;
  const Refiner refiner_;
  const int count_;
  const Ranking ranking_;
  SearchResult result_;
  MapHypotheses maps_;
  std::vector<double> own_gate_;
  double null_spot_ = 0;     // what stands out most in recordings in which nothing is missing
  std::vector<int> placed_;  // hypotheses whose place is known closely
  Remainder base_;
  double left_;                                                     // dispersion, by the best so far
  double second_listed_ = std::numeric_limits<double>::infinity();  // gain of chi, where that was simulated
  const std::optional<CertainStep> certain_;
};

}  // namespace

SearchResult search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                    const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
                    const Standing& standing, const std::function<Beginning()>& beginning,
                    const SearchOptions& options) {
  return Search(experiment, motions, rung, measured, hypotheses, signatures, standing, beginning, options).run();
}

}  // namespace binrig
