#include "diagnose/rung.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "core/parallel.h"
#include "core/random.h"
#include "diagnose/descent.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int short_frames = 3;         // of the last pass; fewest_frames of those before
constexpr int fewest_simulations = 8;   // where many are missing
constexpr double lacks_much = 2;        // dispersion
constexpr double far_from_nominal = 4;  // in prior sigmas: worth a line of the trace

/// What registration leaves open of where targets stand, drawn at random: by draw, in prior sigmas.
std::vector<std::vector<double>> drawn_places(const std::vector<SceneMotion>& motions, int count, std::uint64_t seed) {
  std::vector<std::vector<double>> draws(count, std::vector<double>(motions.size()));
  for (int d = 0; d < count; ++d) {
    const RandomStream stream = RandomStream(seed).child("registration").child(static_cast<std::uint64_t>(d));
    for (std::size_t m = 0; m < motions.size(); ++m) draws[d][m] = left_open(motions[m]) * stream.normal(m);
  }
  return draws;
}

/// The weights of a fit, from a handful of short simulations. Targets stand elsewhere in each: where an edge meets the
/// pixels is chance, and would pass for the trace of a parameter.
Standard short_standard(const Experiment& experiment, const std::vector<SceneMotion>& motions, const StatVector& few,
                        const SensorModel& model, const std::vector<Offset>& offsets, int frames, bool series,
                        std::uint64_t seed) {
  constexpr int simulations = 8;
  const Layout& layout = experiment.layout();
  std::vector<Trial> trials;
  std::vector<StatVector> shifts;
  for (const auto& draw : drawn_places(motions, simulations, seed)) {
    trials.push_back({model, offsets_of(layout, motions, draw, offsets),
                      seed + static_cast<std::uint64_t>(trials.size()), Part::all, frames, !series});
    shifts.push_back(shift_of(layout, motions, draw));
  }
  std::vector<StatVector> result = experiment.simulate(trials, "learning the model's own randomness");
  // But masks are held to the pixels that they lose: free to move, they would lose others to make up for what is
  // missing.
  for (Trial& trial : trials) trial.offsets = offsets;
  const std::vector<StatVector> in_place = experiment.simulate(trials, "learning the model's own randomness");
  for (const Block& block : layout.blocks)
    if (segments()[block.segment].name == "drop-out")
      for (std::size_t k = 0; k < result.size(); ++k)
        std::copy_n(in_place[k].begin() + block.offset, block.size, result[k].begin() + block.offset);
  return Standard(layout, few, result, shifts);
}

/// Moves the targets to where the bias maps want them; returns by how much the furthest moved, in what they are
/// registered to.
double register_targets(const Layout& layout, const std::vector<SceneMotion>& motions,
                        const std::vector<NuisanceRow>& rows, const Whitened& data, std::vector<Offset>& offsets) {
  const auto before = values_of(motions, offsets);
  offsets = offsets_of(layout, motions, Metric(layout, Part::all, rows).explain(data, before).values, {});
  const auto after = values_of(motions, offsets);
  double furthest = 0;
  for (std::size_t m = 0; m < before.size(); ++m)
    furthest = std::max(furthest, std::abs(after[m] - before[m]) / registered_to(motions[m]));
  return furthest;
}

/// Each simulation whitened by what the others teach: one that taught its own mean and correlations would look more
/// regular than any recording.
void whiten_nulls(const Layout& layout, const StatVector& measured, const std::vector<StatVector>& shifts, Rung& rung) {
  constexpr int folds = 4;
  rung.nulls.resize(rung.simulations.size());
  rung.others.resize(folds);
  parallel_for(folds, [&](int fold) {
    std::vector<StatVector> others, their_shifts;
    for (std::size_t k = 0; k < rung.simulations.size(); ++k)
      if (static_cast<int>(k) % folds != fold) others.push_back(rung.simulations[k]), their_shifts.push_back(shifts[k]);
    rung.others[fold] = Standard(layout, measured, others, their_shifts);
    for (std::size_t k = fold; k < rung.simulations.size(); k += folds)
      rung.nulls[k] = rung.others[fold].linear(rung.simulations[k]);
  });
}

/// Mean square of what a metric leaves of the data over that of the nulls, at least 1.
double dispersion_of(const Rung& rung, const Metric& train) {
  double null_square = 0;
  for (const auto& null : rung.nulls) null_square += train.explain(null).chi / rung.nulls.size();
  return null_square > 0 ? std::max(1.0, train.explain(rung.data, rung.place).chi / null_square) : 1;
}

/// What is left of the data, segment by segment, and in the captures that keep most of it.
void trace_rest(const Layout& layout, const Rung& rung) {
  for (std::size_t s = 0; s < segments().size(); ++s) {
    std::vector<std::pair<double, int>> by_capture;
    double square = 0;
    int known = 0;
    for (const Block& block : layout.blocks) {
      if (block.segment != static_cast<int>(s)) continue;
      double own = 0;
      for (int i = block.offset; i < block.offset + block.size; ++i) {
        own += rung.rest[i] * rung.rest[i];
        known += rung.rest[i] != 0;
      }
      square += own;
      by_capture.emplace_back(own, block.capture);
    }
    if (known == 0) continue;
    std::sort(by_capture.rbegin(), by_capture.rend());
    fmt::print(stderr, "  rest of {:<14} {:.2f}", segments()[s].name, square / known);
    for (std::size_t k = 0; k < std::min<std::size_t>(5, by_capture.size()); ++k)
      fmt::print(stderr, ", capture {} {:.0f} %", by_capture[k].second, 100 * by_capture[k].first / square);
    fmt::print(stderr, "\n");
  }
}

/// Simulates the rung's model with everything that may differ from recording to recording, about where its targets
/// stand: fills place, simulations, standard, data and nulls. Returns the rows of targets and intrinsics.
std::vector<NuisanceRow> learn_randomness(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                                          const Measurement& measured, const RungOptions& options, Rung& rung) {
  const Layout& layout = experiment.layout();
  const auto draws = drawn_places(motions, options.pose_draws, options.seed);
  std::vector<StatVector> draw_shift;
  for (const auto& draw : draws) draw_shift.push_back(shift_of(layout, motions, draw));
  std::vector<StatVector> shifts;
  std::vector<NuisanceRow> rows;
  rung.place = values_of(motions, rung.offsets);
  std::set<int> counts{options.simulations / 2, options.simulations};
  if (*counts.begin() > fewest_simulations) counts.insert(fewest_simulations);
  for (const int count : counts) {
    std::vector<Trial> trials;
    for (int k = static_cast<int>(shifts.size()); k < count; ++k) {
      const int d = k % options.pose_draws;
      trials.push_back({rung.model, offsets_of(layout, motions, draws[d], rung.offsets),
                        options.seed + 1000 + static_cast<std::uint64_t>(k), Part::all});
      shifts.push_back(draw_shift[d]);
    }
    auto more = experiment.simulate(trials, "learning the model's own randomness");
    std::move(more.begin(), more.end(), std::back_inserter(rung.simulations));
    rung.standard = Standard(layout, measured.all, rung.simulations, shifts);
    rows = motion_rows(layout, rung.standard, motions);
    rung.data = rung.standard.linear(measured.all);
    whiten_nulls(layout, measured.all, shifts, rung);
    // Where the model is far off, more simulations say nothing more.
    const Metric metric(layout, Part::train, rows);
    if (dispersion_of(rung, metric) > (count < options.simulations / 2 ? many_missing : lacks_much)) break;
  }
  return rows;
}

}  // namespace

void leave_behind(Rung& rung) {
  for (auto* vectors : {&rung.fit.slopes, &rung.fit.simulations, &rung.simulations, &rung.nulls}) vectors->clear();
  rung.fit.seed_slopes.clear();
  rung.others.clear();
  rung.train = rung.test = {};
}

std::vector<std::string> parameters_bent(const Rung& rung, const SensorModel& given, double deviations) {
  std::vector<std::string> result;
  for (std::size_t p = 0; p < rung.fit.parameters.size(); ++p) {
    const FitParameter& parameter = rung.fit.parameters[p];
    const EffectInstance *before = given.find(parameter.id), *now = rung.model.find(parameter.id);
    if (!before || !now || parameter.narrow || rung.fit.paused[p]) continue;
    const double moved = parameter.scaled(now->value(parameter.name)) - parameter.scaled(before->value(parameter.name));
    if (std::abs(moved) > deviations * parameter.prior_sigma) result.push_back(parameter.id + "." + parameter.name);
  }
  return result;
}

bool needs_whole_series(const SensorModel& model, const EffectCatalogue& catalogue) {
  return std::any_of(model.effects.begin(), model.effects.end(), [&](const EffectInstance& effect) {
    return needs_whole_series(effect.declaration(catalogue).needs);
  });
}

Rung fit_rung(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
              const SensorModel& start, const std::vector<Offset>& offsets, const RungOptions& options) {
  const Layout& layout = experiment.layout();
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  Rung rung;
  rung.model = start;
  rung.offsets = offsets;
  rung.offsets.resize(layout.captures);
  std::vector<std::string> ids;
  for (const auto& effect : start.effects) ids.push_back(effect.id);
  auto parameters = fit_parameters(start, catalogue);
  std::erase_if(parameters, [&](const FitParameter& p) {
    return std::find(options.fixed.begin(), options.fixed.end(), p.id + "." + p.name) != options.fixed.end();
  });

  const bool series = needs_whole_series(start, catalogue);
  for (const FitParameter& p : options.narrow)
    if (start.find(p.id)) parameters.push_back(p);
  // Again and again: the spread that the fit is weighted with is the model's own and changes with it.
  for (int pass = 0; pass < options.passes; ++pass) {
    const bool last = pass + 1 == options.passes;
    const bool in_haste = options.converged_far_off > 0 && pass > 0 && rung.fit.dispersion > far_off;
    const int frames = last && !in_haste ? short_frames : fewest_frames;
    const StatVector& few = measured.at(frames, !series);
    const auto learn = [&] {
      rung.standard =
          short_standard(experiment, motions, few, rung.model, rung.offsets, frames, series, options.seed + 9000);
    };
    learn();
    const auto rows = motion_rows(layout, rung.standard, motions);
    // How much the statistics scatter does not change over a small motion.
    if (register_targets(layout, motions, rows, rung.standard.linear(few), rung.offsets) > 2) learn();
    FitOptions fit;
    fit.seeds = 2;  // one would take the noise of its own simulation for a trace of the parameters
    fit.most_frames = frames;
    fit.shorten_series = !series;
    fit.iterations = options.iterations;
    fit.converged = last ? 2 : 100;  // the weights of the first pass are not the model's own yet
    fit.converged_far_off = options.converged_far_off;
    fit.seed = options.seed + 500;
    fit.place = values_of(motions, rung.offsets);
    fit.motions = &motions;
    fit.fixed = options.fixed;
    if (last) {
      fit.scan_ids = ids;
      fit.probe_within = lacks_much;  // of a model that lacks much, masks only bend to make up for it
    } else if (options.scan_all_ranges) {
      fit.scan_ids = ids;
      fit.scan_all_ranges = true;
    } else if (!options.scan_ranges_of.empty()) {
      // What it was refined with were the parameters of a model that lacked it.
      fit.scan_ids = {options.scan_ranges_of};
      fit.scan_ranges_of = options.scan_ranges_of;
    }
    const Metric metric(layout, Part::train, rows);
    rung.fit = fit_model(experiment, rung.standard, metric, rung.standard.linear(few), rung.model, parameters,
                         rung.offsets, fit);
    parameters = rung.fit.parameters;
    if (last && rung.fit.dispersion <= lacks_much) {  // a last step with all frames
      fit.nearby = &rung.fit;
      fit.most_frames = 0;
      fit.iterations = 0;
      fit.scan_ids.clear();
      fit.probe_within = 0;
      fit.place = rung.fit.place;
      const Fit found = fit_model(experiment, rung.standard, metric, rung.standard.linear(measured.all), rung.fit.model,
                                  parameters, rung.fit.offsets, fit);
      rung.fit.model = found.model;
      rung.fit.offsets = found.offsets;
    }
    rung.model = rung.fit.model;
    rung.offsets = rung.fit.offsets;
  }

  if (options.passes > 0) {  // the targets of all captures where the fitted model wants them
    const auto rows = motion_rows(layout, rung.standard, motions);
    FitOptions only_targets;
    only_targets.part = Part::all;
    only_targets.seed = options.seed + 500;
    only_targets.place = values_of(motions, rung.offsets);
    only_targets.motions = &motions;
    rung.offsets = fit_model(experiment, rung.standard, Metric(layout, Part::all, rows),
                             rung.standard.linear(measured.all), rung.model, {}, rung.offsets, only_targets)
                       .offsets;
  }

  auto rows = learn_randomness(experiment, motions, measured, options, rung);

  FitOptions derivatives;
  derivatives.seeds = 2;
  derivatives.iterations = 0;
  derivatives.most_frames = 3;
  derivatives.shorten_series = !series;
  derivatives.seed = options.seed + 500;
  derivatives.part = Part::all;
  derivatives.place = rung.place;
  const int rounds = rung.fit.rounds;
  const bool converged = rung.fit.converged;
  rung.fit =
      fit_model(experiment, rung.standard, Metric(layout, Part::train, rows),
                rung.standard.linear(measured.at(3, !series)), rung.model, parameters, rung.offsets, derivatives);
  rung.fit.rounds = rounds;
  rung.fit.converged = converged;

  const int n = static_cast<int>(rung.fit.parameters.size());
  for (int p = 0; p < n; ++p) {
    NuisanceRow row{rung.fit.slopes[p], -1};
    for (float& v : row.change) v *= static_cast<float>(rung.fit.parameters[p].prior_sigma);
    rows.push_back(std::move(row));
  }
  rung.place.resize(rows.size(), 0);
  rung.train = Metric(layout, Part::train, rows);
  rung.test = Metric(layout, Part::test, rows, rung.train.global_posterior());
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(n), square = sum;
  for (const auto& null : rung.nulls) {
    const Explained own = rung.train.explain(null);
    for (int p = 0; p < n; ++p) {
      const double value = own.values[motions.size() + p] * rung.fit.parameters[p].prior_sigma;
      sum[p] += value;
      square[p] += value * value;
    }
  }
  if (const double count = static_cast<double>(rung.nulls.size()); count > 1)
    rung.fit.scatter = ((square - sum.cwiseProduct(sum) / count) / (count - 1)).cwiseMax(0).cwiseSqrt();
  rung.dispersion = dispersion_of(rung, rung.train);
  if (tracing()) {
    for (const FitParameter& p : rung.fit.parameters)
      fmt::print(stderr, " {}.{} {:.4g}{}", p.id, p.name, rung.model.find(p.id)->value(p.name),
                 rung.fit.paused[&p - rung.fit.parameters.data()] ? " (paused)" : "");
    fmt::print(stderr, "\n");
  }
  Remains remains = remains_of(rung, rung.data, rung.place);
  rung.rest = std::move(remains.rest);
  if (tracing()) trace_rest(layout, rung);
  rung.nuisances = std::move(remains.nuisances);
  if (tracing())
    for (std::size_t m = 0; m < motions.size(); ++m)
      if (motions[m].capture < 0 || std::abs(rung.nuisances[m]) > far_from_nominal)
        fmt::print(stderr, "  {} {} of {} at {:.2f} sigmas, simulated at {:.2f}\n",
                   motions[m].capture < 0 ? "intrinsic" : "motion", motions[m].element,
                   motions[m].capture < 0 ? "the lens" : experiment.captures()[motions[m].capture].name,
                   rung.nuisances[m], rung.place[m]);
  rung.train_stated = remains.train_stated;
  rung.test_stated = remains.test_stated;
  return rung;
}

Rung made_anew(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
               const SensorModel& model, const std::vector<Offset>& offsets, const RungOptions& options,
               const std::vector<FitParameter>& parameters) {
  RungOptions again = options;
  again.passes = 0;
  again.narrow = narrow_of(parameters);
  return fit_rung(experiment, motions, measured, model, offsets, again);
}

Rung unfitted_rung(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                   const SensorModel& model, const std::vector<Offset>& offsets, const RungOptions& options) {
  Rung rung;
  rung.model = model;
  rung.offsets = offsets;
  learn_randomness(experiment, motions, measured, options, rung);
  rung.rest.assign(experiment.layout().size, 0.f);
  return rung;
}

namespace {

Remains remains_of(const Metric& on_train, const Metric& on_test, const Whitened& difference,
                   const std::vector<double>& place) {
  Explained train = on_train.explain(difference, place);
  const Explained test = on_test.explain(difference, place, train.global);
  for (std::size_t i = 0; i < train.rest.size(); ++i) train.rest[i] += test.rest[i];  // one of them is 0
  for (std::size_t i = 0; i < train.values.size(); ++i)
    if (train.values[i] == 0) train.values[i] = test.values[i];  // targets of held-out captures
  return {std::move(train.rest), std::move(train.values), train.stated, test.stated};
}

}  // namespace

Remains remains_of(const Rung& rung, const Whitened& difference, const std::vector<double>& place) {
  return remains_of(rung.train, rung.test, difference, place);
}

Remains remains_of(const Rung& rung, const SensorModel& model, const Whitened& difference,
                   const std::vector<double>& place) {
  const auto& parameters = rung.fit.parameters;
  const std::size_t first = rung.place.size() - parameters.size();  // rows of targets and intrinsics come before
  std::vector<int> held;
  for (std::size_t p = 0; p < parameters.size(); ++p)
    if (!model.find(parameters[p].id)) held.push_back(static_cast<int>(first + p));
  return remains_of(rung.train.with_held(held), rung.test.with_held(held), difference, place);
}

}  // namespace binrig
