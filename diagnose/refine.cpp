#include "diagnose/refine.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

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
