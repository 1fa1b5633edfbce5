#include "diagnose/refine.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include "diagnose/descent.h"
#include "diagnose/mean_of_simulations.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int few_frames = 3;

}  // namespace

int frames_for(const Rung& rung) { return rung.dispersion > far_off ? fewest_frames : 0; }

Refiner on_train(Refiner refiner) {
  refiner.part = Part::train;
  return refiner;
}

Remainder remainder_of(const Refiner& refiner, const SensorModel& model, const std::vector<Offset>& offsets,
                       const std::vector<double>& place) {
  const auto& [experiment, motions, rung, measured, seeds, seed, part, most_frames] = refiner;
  std::vector<Trial> trials;
  for (int k = 0; k < seeds; ++k)
    trials.push_back({model, offsets, seed + static_cast<std::uint64_t>(k), part, most_frames});
  MeanOfSimulations simulated =
      mean_of(rung.standard, simulate_typical_units(experiment, trials, "refining hypotheses"));
  Whitened difference = most_frames == 0 ? rung.data : rung.standard.linear(measured.at(most_frames, false));
  for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= simulated.mean[i];
  Explained train = rung.train.explain(difference, place, {}, simulated.noise);
  const double scatter = seeds * train.noise;
  if (part == Part::train) return {std::move(simulated.mean), train.chi, 0, scatter, std::move(train.values)};
  const Explained test = rung.test.explain(difference, place, train.global, simulated.noise);
  // A target is in train or in test, and 0 in the other; what all captures share was found on train.
  for (std::size_t r = 0; r < train.values.size(); ++r)
    if (train.values[r] == 0) train.values[r] = test.values[r];
  // Intrinsics that the captures held out want far from where they are said to be count there, too.
  return {std::move(simulated.mean), train.chi, test.chi + test.shared_prior, scatter, std::move(train.values)};
}

namespace {

/// Where a model wants the targets: under the rung's model they may have been moved far away to make up for what it
/// lacks.
struct Places {
  std::vector<Offset> offsets;
  std::vector<double> values;  ///< see Metric::explain
};
Places places_for(const Refiner& refiner, const SensorModel& model) {
  Remainder nominal = remainder_of(refiner, model, {}, {});
  nominal.values.resize(refiner.motions.size());
  Places places{offsets_of(refiner.experiment.layout(), refiner.motions, nominal.values, {}), {}};
  places.values = values_of(refiner.motions, places.offsets);
  places.values.resize(refiner.rung.place.size(), 0);
  return places;
}

/// Those that gain most among their neighbours, best first, and at least half of what the best does.
std::vector<LinearGain> peaks_of(std::vector<LinearGain> gains) {
  constexpr double close_behind = 0.5;
  constexpr std::size_t most = 4;
  std::vector<LinearGain> peaks;
  for (std::size_t k = 0; k < gains.size(); ++k) {
    const bool rises = k < 2 || gains[k].gain >= gains[k - 1].gain;  // the first one is no neighbour
    const bool falls = k == 0 || k + 1 == gains.size() || gains[k].gain >= gains[k + 1].gain;
    if (rises && falls) peaks.push_back(std::move(gains[k]));
  }
  std::ranges::sort(peaks, std::greater(), &LinearGain::gain);
  while (peaks.size() > most || peaks.back().gain < close_behind * peaks.front().gain) peaks.pop_back();
  return peaks;
}

/// The captures of most power, at most so many.
std::vector<int> strongest(const std::vector<double>& power, int most) {
  std::vector<int> captures(power.size());
  std::iota(captures.begin(), captures.end(), 0);
  std::ranges::stable_sort(captures, std::greater(), [&](int c) { return power[c]; });
  captures.resize(std::min<std::size_t>(most, std::ranges::count_if(power, [](double p) { return p > 0; })));
  return captures;
}

/// Places in the list of the third that gains most, in the order of the list.
std::vector<int> best_third(const std::vector<LinearGain>& gains) {
  std::vector<int> order(gains.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, std::greater(), [&](int k) { return gains[k].gain; });
  order.resize((order.size() + 2) / 3);
  std::ranges::sort(order);
  return order;
}

/// The one that leaves least when it is simulated.
LinearGain best_simulated(const Refiner& refiner, const Hypothesis& hypothesis, std::vector<LinearGain> peaks) {
  const EffectCatalogue& catalogue = refiner.experiment.forward().catalogue();
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < peaks.size() && peaks.size() > 1; ++k) {
    const SensorModel model = with_effect(refiner.rung.model, catalogue, hypothesis.effect, peaks[k].values);
    const double chi = registered_remainder(on_train(refiner), model).train;
    if (tracing()) {
      fmt::print(stderr, "  {} gain {:.0f} leaves {:.0f}:", hypothesis.effect, peaks[k].gain, chi);
      for (const auto& [name, value] : peaks[k].values) fmt::print(stderr, " {} {:.4g}", name, value);
      fmt::print(stderr, "\n");
    }
    if (chi < least) least = chi, best = k;
  }
  return std::move(peaks[best]);
}

/// Of the values that a step is tried at, the one that leaves least when it is simulated.
LinearGain best_step(const Refiner& refiner, const Hypothesis& hypothesis, LinearGain start) {
  const EffectCatalogue& catalogue = refiner.experiment.forward().catalogue();
  double least = std::numeric_limits<double>::infinity();
  for (const StrengthPath& path : hypothesis.paths)
    for (const Atom& atom : path.atoms) {
      const SensorModel model = with_effect(refiner.rung.model, catalogue, hypothesis.effect, atom.values);
      const double chi = remainder_of(on_train(refiner), model, refiner.rung.offsets, refiner.rung.place).train;
      if (tracing())
        fmt::print(stderr, "  {} {:.5g} leaves {:.0f}\n", hypothesis.effect,
                   atom.values.at(hypothesis.declaration->amplitude), chi);
      if (chi < least) least = chi, start.values = atom.values;
    }
  return start;
}

}  // namespace

Remainder registered_remainder(const Refiner& refiner, const SensorModel& model) {
  const Places places = places_for(refiner, model);
  return remainder_of(refiner, model, places.offsets, places.values);
}

void add_power(const Layout& layout, const Whitened& change, std::vector<double>& power) {
  for (const Block& block : layout.blocks)
    for (int i = block.offset; i < block.offset + block.size; ++i)
      power[block.capture] += static_cast<double>(change[i]) * change[i];
}

LinearGain look_close_by(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start,
                         const std::vector<Signature>& signatures, std::optional<double> reach, double least) {
  const Experiment& experiment = refiner.experiment;
  const Rung& rung = refiner.rung;
  const int cols = experiment.nominal(0).depth_mm.cols;
  if (is_step(*hypothesis.declaration)) return best_step(refiner, hypothesis, start);
  const bool place = has_place(*hypothesis.declaration);
  if (!place && !has_period(*hypothesis.declaration)) return start;
  std::vector<double> power(experiment.layout().captures, 0);
  for (const Signature& signature : signatures)
    if (signature.hypothesis == start.hypothesis)
      add_power(experiment.layout(), rung.standard.difference(*signature.change), power);
  SignatureOptions few;
  few.seeds = 1;
  few.most_frames = 2;
  few.seed = refiner.seed + 20;
  few.shared = false;
  const auto gains = [&](std::vector<Hypothesis> close, int captures) {
    few.only = strongest(power, captures);
    return gains_about(experiment, rung, {std::move(close), {}}, few);
  };
  constexpr int scanned = 3, compared = 6;  // captures: a few targets do not tell a wave from some others
  LinearGain found;
  if (place) {
    found = gains({by_place(hypothesis, start.values, reach)}, scanned)[0];
  } else {
    std::vector<Hypothesis> periods = by_period(hypothesis, start.values, cols);
    std::vector<LinearGain> peaks = gains(periods, scanned);
    const double best = std::ranges::max(peaks, {}, &LinearGain::gain).gain;
    if (best * experiment.layout().captures < scanned * least) return start;  // nowhere does it change more
    const std::vector<int> hopeful = best_third(peaks);
    std::vector<Hypothesis> closer;
    for (const int k : hopeful) closer.push_back(std::move(periods[k]));
    for (LinearGain& peak : peaks) peak.gain = 0;
    const std::vector<LinearGain> again = gains(std::move(closer), compared);
    for (std::size_t k = 0; k < hopeful.size(); ++k) peaks[hopeful[k]] = again[k];
    peaks = peaks_of(std::move(peaks));
    if (peaks[0].gain <= 0) return start;
    // Maps are of cells of several pixels, which see a short period as a long one: what is nearest there is simulated.
    for (LinearGain& peak : peaks)
      peak = std::ranges::max(gains(by_period_near(hypothesis, peak.values, cols), compared), {}, &LinearGain::gain);
    found = best_simulated(refiner, hypothesis, std::move(peaks));
  }
  found.hypothesis = start.hypothesis;
  if (tracing()) {
    fmt::print(stderr, "  {}:", hypothesis.effect);
    for (const auto& [name, value] : found.values) fmt::print(stderr, " {} {:.4g}", name, value);
    fmt::print(stderr, " gain {:.0f} in {} captures\n", found.gain, few.only.size());
  }
  return found.gain > 0 ? found : start;
}

RefinedFit refine(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start) {
  const auto& [experiment, motions, rung, measured, seeds, seed, part, most_frames] = refiner;
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  SensorModel model = rung.model;
  const std::string id = add_effect(model, catalogue, hypothesis.effect, start.values).id;
  const ParameterSpec* amplitude = hypothesis.declaration->parameter(hypothesis.declaration->amplitude);
  if (amplitude && amplitude->interpolate) {
    auto values = start.values;
    double& value = values[amplitude->name];
    const Refiner trying = on_train(refiner);
    double best = registered_remainder(trying, model).train;
    const auto better = [&](double other) {
      const double before = value;
      value = std::clamp(other, amplitude->lower, amplitude->upper);
      const SensorModel changed = with_effect(rung.model, catalogue, hypothesis.effect, values);
      const double its = registered_remainder(trying, changed).train;
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
  FitOptions fit;
  fit.seeds = 2;
  fit.most_frames = rung.dispersion > far_off ? fewest_frames : few_frames;
  fit.shorten_series = !needs_whole_series(hypothesis.declaration->needs);
  fit.iterations = 5;
  fit.converged = 1;
  fit.converged_far_off = 0.003;
  fit.seed = seed + 40;
  if (!hypothesis.seen_at(start.values)) fit.scan_ids = {id};
  fit.probe_within = std::numeric_limits<double>::infinity();
  fit.scan_ranges_of = id;
  const auto parameters = fit_parameters(model, catalogue, {id});
  Places places = places_for(refiner, model);
  // Where the model's noise is far off, too, a wrong step is the better for what less noise would make of it if its
  // logarithm went straight down: there the model's own parameters stay where they are while steps are compared.
  const bool compares_steps = rung.dispersion > far_off && is_step(*hypothesis.declaration);
  const Layout& layout = experiment.layout();
  const Metric standing =
      compares_steps ? Metric(layout, Part::train, motion_rows(layout, rung.standard, motions)) : Metric();
  if (compares_steps) places.values.resize(motions.size());
  fit.place = places.values;
  fit.motions = &motions;
  const Whitened few = rung.standard.linear(measured.at(fit.most_frames, fit.shorten_series));
  Fit first = fit_model(experiment, rung.standard, compares_steps ? standing : rung.train, few, model, parameters,
                        places.offsets, fit);
  // Where the rung is far off, all frames say no more than a few.
  if (first.parameters.empty() || rung.dispersion > far_off) return {id, std::move(first)};
  fit.nearby = &first;  // a last step with all frames
  fit.place = first.place;
  fit.most_frames = 0;
  fit.iterations = 0;
  fit.scan_ids.clear();
  fit.probe_within = 0;
  return {id, fit_model(experiment, rung.standard, rung.train, rung.data, first.model, first.parameters, first.offsets,
                        fit)};
}

}  // namespace binrig
