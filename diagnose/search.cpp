#include "diagnose/search.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "core/error.h"
#include "diagnose/anew.h"
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
  return {std::move(simulated.mean), train.chi, test.chi, std::move(train.values)};
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

Refined refine(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
               const Measurement& measured, const Hypothesis& hypothesis, const LinearGain& start,
               const SearchOptions& options) {
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  SensorModel model = rung.model;
  Refined refined;
  refined.effect = hypothesis.effect;
  refined.id = add_effect(model, catalogue, hypothesis.effect, start.values).id;
  refined.linear_gain = start.gain;
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
  if (!parameters.empty()) {  // a last step with all frames
    const Fit first = std::move(refined.fit);
    fit.slopes = &first.slopes;
    fit.place = first.place;
    fit.most_frames = 0;
    fit.iterations = 0;
    fit.scan_ids.clear();
    refined.fit =
        fit_model(experiment, rung.standard, rung.train, rung.data, first.model, parameters, first.offsets, fit);
  }
  refined.model = refined.fit.model;
  return refined;
}

/// Of the hypotheses that draw a map, by index.
std::map<int, UnitMap> unit_maps(const Experiment& experiment, const Rung& rung, const Hypotheses& hypotheses,
                                 const std::vector<LinearGain>& linear, const SearchOptions& options) {
  std::map<int, UnitMap> maps;
  std::vector<StatVector> without;
  for (int h = 0; h < static_cast<int>(hypotheses.tested.size()); ++h) {
    const Hypothesis& hypothesis = hypotheses.tested[h];
    if (!hypothesis.declaration->per_unit_map) continue;
    const auto simulate = [&](const SensorModel& model) {
      return experiment.simulate(UnitMap::trials_of(rung, model, options.seed + 80), "simulating units");
    };
    if (without.empty()) without = simulate(rung.model);
    maps.emplace(h, UnitMap(experiment.layout(), rung, without,
                            simulate(with_effect(rung.model, experiment.forward().catalogue(), hypothesis.effect,
                                                 linear[h].values))));
  }
  return maps;
}

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + static_cast<long>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

SearchResult search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                    const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
                    const SignatureBook& book, const SearchOptions& options) {
  SearchResult result;
  const int count = static_cast<int>(hypotheses.tested.size());
  const Ranking ranking(experiment, rung, hypotheses, signatures);
  result.linear = ranking.gains(rung.rest);
  result.null_gains.resize(count);
  const std::map<int, UnitMap> maps = unit_maps(experiment, rung, hypotheses, result.linear, options);
  std::map<int, UnitMap::Gain> by_map;  // of those that look random
  for (const auto& [h, map] : maps) {
    if (!map.looks_random(rung.rest)) continue;
    by_map[h] = map.gain(rung.rest, rung.rest);
    result.linear[h].gain += by_map[h].train;
  }
  std::vector<std::vector<LinearGain>> nulls;
  for (const auto& null : rung.nulls) {
    const Whitened rest = rung.train.explain(null).rest;
    nulls.push_back(ranking.gains(rest));
    for (const auto& [h, map] : maps) nulls.back()[h].gain += map.gain(rest, rest).train;
  }
  for (int h = 0; h < count; ++h) {
    double mean = 0;
    for (const auto& null : nulls) {
      result.null_gains[h].push_back(null[h].gain);
      mean += null[h].gain / nulls.size();
    }
    result.prices.push_back(mean);
    result.p_values.push_back(gain_p_value(result.linear[h].gain / rung.dispersion, result.null_gains[h]));
  }
  // A few wild simulations of one hypothesis (holes where none of the others has any) must not hide all others: the
  // common bar is a robust one, and each hypothesis has to clear its own besides.
  std::vector<double> best_null;
  for (const auto& null : nulls) {
    double best = 0;
    for (int h = 0; h < count; ++h) best = std::max(best, null[h].gain - result.prices[h]);
    best_null.push_back(best);
  }
  const double middle = quantile(best_null, 0.5);
  result.gate = middle + 3 * std::max((quantile(best_null, 0.84) - middle), 0.3 * middle);
  std::vector<double> own_gate(count);
  for (int h = 0; h < count; ++h) {
    double square = 0;
    for (double gain : result.null_gains[h]) square += std::pow(gain - result.prices[h], 2) / nulls.size();
    own_gate[h] = std::max(result.gate, 3 * std::sqrt(square));
  }

  std::vector<int> order(count);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return result.linear[a].gain > result.linear[b].gain; });
  const Remainder base = registered_remainder(experiment, motions, rung, rung.model, options);
  // Where much is unexplained, the linear view of signatures may mislead: what is left when they are simulated decides
  // who is fitted.
  std::vector<std::pair<double, int>> shortlist;
  for (int h : order) {
    if (static_cast<int>(shortlist.size()) >= options.shortlist) break;
    if (result.linear[h].gain / rung.dispersion - result.prices[h] < own_gate[h]) continue;
    shortlist.emplace_back(0, h);
  }
  const bool simulated = rung.dispersion > options.linear_until && static_cast<int>(shortlist.size()) > options.refine;
  const double nominal =
      simulated ? remainder_of(experiment, rung, rung.model, {}, {}, options).train : 0;  // where signatures stand
  for (auto& [gain, h] : shortlist)
    gain = simulated ? nominal - remainder_of(experiment, rung,
                                              with_effect(rung.model, experiment.forward().catalogue(),
                                                          hypotheses.tested[h].effect, result.linear[h].values),
                                              {}, {}, options)
                                     .train
                     : result.linear[h].gain;
  std::stable_sort(shortlist.begin(), shortlist.end(), [](auto& a, auto& b) { return a.first > b.first; });
  shortlist.resize(std::min<std::size_t>(shortlist.size(), options.refine));
  double left = rung.dispersion;  // by the best of them
  const auto judge = [&](Refined refined, int h) {
    refined.price = result.prices[h];
    refined.gate = own_gate[h];
    refined.p = result.p_values[h];
    refined.random_map = !maps.count(h) || by_map.count(h);
    const Remainder with = registered_remainder(experiment, motions, rung, refined.model, options);
    const UnitMap::Gain map = by_map.count(h) ? by_map.at(h) : UnitMap::Gain{};
    refined.train_gain = (base.train - with.train + map.train) / rung.dispersion;
    refined.test_gain = (base.test - with.test + map.test) / rung.dispersion;
    refined.change = with.mean;
    for (std::size_t i = 0; i < refined.change.size(); ++i) refined.change[i] -= base.mean[i];
    compress(refined.change);
    left = std::min(left, rung.dispersion * with.train / base.train);
    result.refined.push_back(std::move(refined));
  };
  std::vector<int> refined_of;  // hypothesis, by refined
  double most_explained = 0;
  for (const auto& [gain, h] : shortlist) {
    // One that explains far less before it is fitted will not be the best when it is.
    const auto& parameters = hypotheses.tested[h].declaration->parameters;
    const bool to_be_scanned =
        std::any_of(parameters.begin(), parameters.end(), [](const ParameterSpec& spec) { return !spec.interpolate; });
    if (gain < (to_be_scanned ? 0.5 : 1) * options.hopeless * most_explained) continue;
    judge(refine(experiment, motions, rung, measured, hypotheses.tested[h], result.linear[h], options), h);
    refined_of.push_back(h);
    most_explained = std::max(most_explained, result.refined.back().train_gain * rung.dispersion);
  }
  if (left > options.astray) {
    int best = -1;
    double highest = 0;
    for (std::size_t k = 0; k < result.refined.size(); ++k)
      if (result.refined[k].score() > highest) highest = result.refined[k].score(), best = refined_of[k];
    for (Anew& anew : look_anew(experiment, motions, measured, book.model(), hypotheses, signatures, book.simulations(),
                                best, options.anew, options.seed + 60)) {
      Refined refined;
      refined.effect = hypotheses.tested[anew.hypothesis].effect;
      refined.id = anew.id;
      refined.linear_gain = result.linear[anew.hypothesis].gain;
      refined.model = anew.fit.model;
      refined.fit = std::move(anew.fit);
      judge(std::move(refined), anew.hypothesis);
    }
  }
  std::sort(result.refined.begin(), result.refined.end(),
            [](const Refined& a, const Refined& b) { return a.score() > b.score(); });
  return result;
}

std::vector<const Refined*> SearchResult::accepted(const SearchOptions& options) const {
  std::vector<const Refined*> result;
  for (const auto& candidate : refined)
    if (candidate.test_gain > options.least_test_gain &&
        candidate.train_gain - candidate.price > std::max(candidate.gate, options.least_train_gain))
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
  return lost < 9 || (s.cosine > 0.9 && lost < 2 * std::sqrt(s.distance2));
}

}  // namespace binrig
