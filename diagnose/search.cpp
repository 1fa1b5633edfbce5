#include "diagnose/search.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include "core/error.h"
#include "diagnose/anew.h"
#include "diagnose/mean_of_simulations.h"
#include "diagnose/screen.h"
#include "diagnose/trace.h"
#include "diagnose/unit_map.h"

namespace binrig {
namespace {

/// What a model leaves of the data, by part.
struct Remainder {
  Whitened mean;
  double train = 0, test = 0;  ///< chi
  std::vector<double> values;  ///< of the nuisances, in prior sigmas from nominal
};

Remainder remainder_of(const Experiment& experiment, const Rung& rung, const SensorModel& model,
                       const std::vector<Offset>& offsets, const std::vector<double>& place,
                       const SearchOptions& options) {
  std::vector<Trial> trials;
  for (int k = 0; k < options.seeds; ++k)
    trials.push_back({model, offsets, options.seed + static_cast<std::uint64_t>(k), Part::all});
  MeanOfSimulations simulated =
      mean_of(rung.standard, simulate_typical_units(experiment, trials, "refining hypotheses"));
  Whitened difference = rung.data;
  for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= simulated.mean[i];
  Explained train = rung.train.explain(difference, place, {}, simulated.noise);
  const Explained test = rung.test.explain(difference, place, train.global, simulated.noise);
  // A target is in train or in test, and 0 in the other; what all captures share was found on train.
  for (std::size_t r = 0; r < train.values.size(); ++r)
    if (train.values[r] == 0) train.values[r] = test.values[r];
  // Intrinsics that the captures held out want far from where they are said to be count there, too.
  return {std::move(simulated.mean), train.chi, test.chi + test.shared_prior, std::move(train.values)};
}

/// Where a model wants the targets: under the rung's model they may have been moved far away to make up for what it
/// lacks.
struct Places {
  std::vector<Offset> offsets;
  std::vector<double> values;  ///< see Metric::explain
};
Places places_for(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                  const SensorModel& model, const SearchOptions& options) {
  Remainder nominal = remainder_of(experiment, rung, model, {}, {}, options);
  nominal.values.resize(motions.size());
  Places places{offsets_of(experiment.layout(), motions, nominal.values, {}), {}};
  places.values = values_of(motions, places.offsets);
  places.values.resize(rung.place.size(), 0);
  return places;
}

Remainder registered_remainder(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                               const SensorModel& model, const SearchOptions& options) {
  const Places places = places_for(experiment, motions, rung, model, options);
  return remainder_of(experiment, rung, model, places.offsets, places.values, options);
}

/// Square of a change by capture, added to what is there.
void add_power(const Layout& layout, const Whitened& change, std::vector<double>& power) {
  for (const Block& block : layout.blocks)
    for (int i = block.offset; i < block.offset + block.size; ++i)
      power[block.capture] += static_cast<double>(change[i]) * change[i];
}

/// Where a hypothesis has a period and a phase, its best ones: what the signatures say of them is of a few periods
/// only. Simulated are the captures in which its signatures change most.
LinearGain with_period(const Experiment& experiment, const Rung& rung, const Hypothesis& hypothesis,
                       const LinearGain& start, const std::vector<Signature>& signatures,
                       const SearchOptions& options) {
  Hypotheses close;
  close.tested.push_back(by_period(hypothesis, start.values, experiment.nominal(0).depth_mm.cols));
  auto& paths = close.tested[0].paths;
  if (paths.empty()) return start;
  // And the one to beat: what is left where poses went astray may lead anywhere.
  for (int quarter : {0, 1}) {
    const Atom& like = paths[quarter].atoms[0];
    StrengthPath own = paths[quarter];
    own.atoms[0].values = start.values;
    for (const auto& spec : hypothesis.declaration->parameters)
      if (spec.kind == ParameterKind::phase || spec.name == hypothesis.declaration->amplitude)
        own.atoms[0].values[spec.name] = like.values.at(spec.name);
    if (quarter) own.quadrature_of = static_cast<int>(paths.size()) - 1;
    paths.push_back(own);
  }
  std::vector<double> power(experiment.layout().captures, 0);
  for (const Signature& signature : signatures)
    if (signature.hypothesis == start.hypothesis)
      add_power(experiment.layout(), rung.standard.difference(signature.change), power);
  SignatureOptions few;
  few.seeds = 1;
  few.most_frames = 2;
  few.seed = options.seed + 20;
  few.shared = false;
  for (int k = 0; k < 3; ++k) {
    const auto most = std::max_element(power.begin(), power.end());
    if (*most <= 0) break;
    few.only.push_back(static_cast<int>(most - power.begin()));
    *most = -1;
  }
  SignatureBook book(experiment, rung.model, close, few);
  book.look_at({0}, false);
  LinearGain found = Ranking(experiment, rung, close, book.signatures()).gains(rung.rest, rung.nuisances)[0];
  if (tracing()) {
    fmt::print(stderr, "  {}:", hypothesis.effect);
    for (const auto& [name, value] : found.values) fmt::print(stderr, " {} {:.4g}", name, value);
    fmt::print(stderr, " gain {:.0f} in {} captures\n", found.gain, few.only.size());
  }
  return found.gain > 0 ? found : start;
}

Refined refine(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
               const Measurement& measured, const Hypothesis& hypothesis, const LinearGain& start,
               const SearchOptions& options) {
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  SensorModel model = rung.model;
  Refined refined;
  refined.id = add_effect(model, catalogue, hypothesis.effect, start.values).id;
  const ParameterSpec* amplitude = hypothesis.declaration->parameter(hypothesis.declaration->amplitude);
  if (amplitude && amplitude->interpolate) {
    auto values = start.values;
    double& value = values[amplitude->name];
    const auto chi = [&](const SensorModel& m) {
      return registered_remainder(experiment, motions, rung, m, options).train;
    };
    double best = chi(model);
    const auto better = [&](double other) {
      const double before = value;
      value = std::clamp(other, amplitude->lower, amplitude->upper);
      const SensorModel changed = with_effect(rung.model, catalogue, hypothesis.effect, values);
      const double its = chi(changed);
      if (tracing())
        fmt::print(stderr, "  {} {} {:.4g}: chi {:.0f} (best {:.0f})\n", hypothesis.effect, amplitude->name, value, its,
                   best);
      if (its < best) return best = its, model = changed, true;
      value = before;
      return false;
    };
    // Variances and shares do not turn round with the sign as the linear view has it: both signs are simulated. And
    // where poses or intrinsics went far to make up for what is missing, the linear view ends early.
    if (amplitude->either_sign) better(-value);
    while (std::abs(value) < strength_value(*hypothesis.declaration, Strength::strong) && better(3 * value)) {
    }
  }
  const Needs& needs = hypothesis.declaration->needs;
  FitOptions fit;
  fit.seeds = 2;
  fit.most_frames = 3;
  fit.shorten_series = !(needs.power_on || needs.repeats || needs.motion);
  fit.iterations = 5;
  fit.converged = 1;
  fit.seed = options.seed + 40;
  fit.scan_ids = {refined.id};
  fit.scan_ranges_of = refined.id;
  const auto parameters = fit_parameters(model, catalogue, {refined.id});
  const Places places = places_for(experiment, motions, rung, model, options);
  fit.place = places.values;
  fit.motions = &motions;
  const Whitened few = rung.standard.linear(measured.at(fit.most_frames, fit.shorten_series));
  refined.fit = fit_model(experiment, rung.standard, rung.train, few, model, parameters, places.offsets, fit);
  if (!refined.fit.parameters.empty()) {  // a last step with all frames
    const Fit first = std::move(refined.fit);
    fit.nearby = &first;
    fit.place = first.place;
    fit.most_frames = 0;
    fit.iterations = 0;
    fit.scan_ids.clear();
    refined.fit =
        fit_model(experiment, rung.standard, rung.train, rung.data, first.model, first.parameters, first.offsets, fit);
  }
  refined.model = refined.fit.model;
  return refined;
}

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + static_cast<long>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

class Search {
 public:
  Search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
         const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
         const SignatureBook& book, const SearchOptions& options)
      : experiment_(experiment),
        motions_(motions),
        rung_(rung),
        measured_(measured),
        hypotheses_(hypotheses),
        signatures_(signatures),
        book_(book),
        options_(options),
        count_(static_cast<int>(hypotheses.tested.size())),
        left_(rung.dispersion) {}

  SearchResult run() {
    hold_signatures_against_residual();
    set_gates();
    base_ = registered_remainder(experiment_, motions_, rung_, rung_.model, options_);
    refine_shortlist();
    // Signatures are of the model as given, without what was added to it since.
    const double astray = result_.accepted(options_).empty() ? options_.unexplained : options_.astray;
    // Where poses or intrinsics made up for what is missing, the rest says little of it.
    const bool misplaced = std::max(rung_.train_stated.intrinsics, rung_.train_stated.poses) > options_.misplaced;
    if ((left_ > astray || misplaced) && rung_.model.effects.size() == book_.model().effects.size()) look_again();
    std::sort(result_.refined.begin(), result_.refined.end(),
              [](const Refined& a, const Refined& b) { return a.score() > b.score(); });
    return std::move(result_);
  }

 private:
  /// Of the hypotheses that draw a map.
  void learn_unit_maps() {
    std::vector<StatVector> without;
    for (int h = 0; h < count_; ++h) {
      const Hypothesis& hypothesis = hypotheses_.tested[h];
      if (!hypothesis.declaration->per_unit_map) continue;
      const auto simulate = [&](const SensorModel& model) {
        return experiment_.simulate(UnitMap::trials_of(rung_, model, options_.seed + 80), "simulating units");
      };
      if (without.empty()) without = simulate(rung_.model);
      const UnitMap map(experiment_.layout(), rung_, without, simulate(added(h)));
      const UnitMap::Gain gain = map.gain(rung_.rest, rung_.rest);
      if (map.looks_random(rung_.rest) && (map.gain(rung_.rest, rung_.rest, "bias").train < worth_a_look || !shaped()))
        map_gains_[h] = gain;
      maps_.emplace(h, map);
    }
  }

  bool shaped() {
    if (!shaped_) shaped_ = has_simple_shape(experiment_, rung_, measured_.all);
    return *shaped_;
  }

  /// The rung's model with a hypothesis where the linear view puts it.
  SensorModel added(int h) const {
    return with_effect(rung_.model, experiment_.forward().catalogue(), hypotheses_.tested[h].effect,
                       result_.linear[h].values);
  }

  /// Gains of all hypotheses, on the data and on recordings in which nothing is missing.
  void hold_signatures_against_residual() {
    const Ranking ranking(experiment_, rung_, hypotheses_, signatures_);
    result_.linear = ranking.gains(rung_.rest, rung_.nuisances);
    learn_unit_maps();
    for (const auto& [h, gain] : map_gains_) result_.linear[h].gain += gain.train;
    result_.null_gains.resize(count_);
    for (const auto& null : rung_.nulls) {
      const Explained explained = rung_.train.explain(null);
      const Whitened& rest = explained.rest;
      auto gains = ranking.gains(rest, explained.values);
      for (const auto& [h, map] : maps_) gains[h].gain += map.gain(rest, rest).train;
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
  std::vector<Listed> shortlist() const {
    std::vector<int> order(count_);
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(),
              [&](int a, int b) { return result_.linear[a].gain > result_.linear[b].gain; });
    std::vector<Listed> list;
    for (int h : order) {
      if (static_cast<int>(list.size()) >= options_.shortlist) break;
      const double gain = result_.linear[h].gain;
      if (gain / rung_.dispersion - result_.prices[h] >= own_gate_[h]) list.push_back({gain, h});
    }
    if (rung_.dispersion > options_.linear_until && static_cast<int>(list.size()) > options_.refine) {
      // Signatures stand where the targets nominally do.
      const double nominal = remainder_of(experiment_, rung_, rung_.model, {}, {}, options_).train;
      for (auto& [gain, h] : list)
        gain = nominal - remainder_of(experiment_, rung_, added(h), {}, {}, options_).train + map_gain(h).train;
      std::stable_sort(list.begin(), list.end(), [](const Listed& a, const Listed& b) { return a.gain > b.gain; });
    }
    list.resize(std::min<std::size_t>(list.size(), options_.refine));
    return list;
  }

  UnitMap::Gain map_gain(int h) const { return map_gains_.count(h) ? map_gains_.at(h) : UnitMap::Gain{}; }

  /// What a refined hypothesis gains, by simulation.
  void judge(Refined refined, int h) {
    refined.hypothesis = h;
    refined.effect = hypotheses_.tested[h].effect;
    refined.linear_gain = result_.linear[h].gain;
    refined.price = result_.prices[h];
    refined.gate = own_gate_[h];
    refined.p = result_.p_values[h];
    refined.random_map = !maps_.count(h) || map_gains_.count(h);
    SearchOptions options = options_;
    if (hypotheses_.tested[h].declaration->needs.repeats)
      options.seeds = 4 * options_.seeds;  // it happens, or does not
    const Remainder with = registered_remainder(experiment_, motions_, rung_, refined.model, options);
    refined.train_gain = (base_.train - with.train + map_gain(h).train) / rung_.dispersion;
    refined.test_gain = (base_.test - with.test + map_gain(h).test) / rung_.dispersion;
    const double excess = base_.train * (1 - 1 / rung_.dispersion);
    if (excess > 0) refined.share = refined.train_gain * rung_.dispersion / excess;
    refined.change = with.mean;
    for (std::size_t i = 0; i < refined.change.size(); ++i) refined.change[i] -= base_.mean[i];
    compress(refined.change);
    refined.shown_on_test = dot(rung_.test.apply(refined.change), refined.change) / rung_.dispersion;
    std::vector<double> power(experiment_.layout().captures, 0);
    add_power(experiment_.layout(), rung_.train.apply(refined.change), power);
    refined.shown_in = static_cast<int>(std::max_element(power.begin(), power.end()) - power.begin());
    left_ = std::min(left_, rung_.dispersion * with.train / base_.train);
    result_.refined.push_back(std::move(refined));
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
      const LinearGain start = with_period(experiment_, rung_, hypothesis, result_.linear[h], signatures_, options_);
      judge(refine(experiment_, motions_, rung_, measured_, hypothesis, start, options_), h);
      most_explained = std::max(most_explained, result_.refined.back().train_gain * rung_.dispersion);
    }
  }

  /// From the model as it was given, unless that names the best one, too.
  void look_again() {
    const auto best = std::max_element(result_.refined.begin(), result_.refined.end(),
                                       [](const Refined& a, const Refined& b) { return a.score() < b.score(); });
    const int known = best == result_.refined.end() ? -1 : best->hypothesis;
    for (Anew& anew : look_anew(experiment_, motions_, measured_, book_.model(), hypotheses_, signatures_,
                                book_.simulations(), known, options_.anew, options_.seed + 60)) {
      Refined refined;
      refined.id = anew.id;
      refined.model = anew.fit.model;
      refined.fit = std::move(anew.fit);
      judge(std::move(refined), anew.hypothesis);
    }
  }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const Measurement& measured_;
  const Hypotheses& hypotheses_;
  const std::vector<Signature>& signatures_;
  const SignatureBook& book_;
  const SearchOptions& options_;
  const int count_;
  SearchResult result_;
  static constexpr double worth_a_look = 30;  // gain of chi
  std::optional<bool> shaped_;                // the bias has a simple shape
  std::map<int, UnitMap> maps_;               // by hypothesis
  std::map<int, UnitMap::Gain> map_gains_;    // of those that look random
  std::vector<double> own_gate_;
  Remainder base_;
  double left_;  // dispersion, by the best so far
};

}  // namespace

SearchResult search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                    const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
                    const SignatureBook& book, const SearchOptions& options) {
  return Search(experiment, motions, rung, measured, hypotheses, signatures, book, options).run();
}

namespace {

bool significant_on_train(const Refined& candidate, const SearchOptions& options) {
  return candidate.share > options.least_share &&
         candidate.train_gain - candidate.price > std::max(candidate.gate, options.least_train_gain);
}

}  // namespace

std::vector<const Refined*> SearchResult::accepted(const SearchOptions& options) const {
  std::vector<const Refined*> result;
  for (const auto& candidate : refined)
    if (candidate.test_gain > options.least_test_gain && significant_on_train(candidate, options))
      result.push_back(&candidate);
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

bool confounded(const Rung& rung, const Refined& a, const Refined& b) {
  // Were a the truth, b would lose by D +- 2 sqrt(D), D their squared distance; were b the truth it would win by as
  // much. The data decide unless D is within two standard deviations of nothing, or the loss is.
  const double lost = a.score() - b.score();
  const Separation s = separation(rung, a, b);
  // And nobody simulates an effect to better than a hundredth of what it does.
  return lost < 9 || (s.cosine > 0.9 && lost < 2 * std::sqrt(s.distance2)) ||
         (s.cosine > 0.99 && lost < 0.01 * a.score());
}

}  // namespace binrig
