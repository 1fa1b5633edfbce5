#include "diagnose/diagnose.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <set>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "diagnose/score.h"
#include "diagnose/screen.h"

namespace binrig {
namespace {

/// Share of the targets' pixels that have depth, and medians over the bins of |measured - nominal| and of the ratio.
struct Plausibility {
  double known_share = 0, median_error_mm = 0, median_ratio = 1;
};

Plausibility plausibility(const Experiment& experiment, const StatVector& data) {
  Plausibility result;
  std::vector<double> errors, ratios;
  for (int c = 0; c < experiment.layout().captures; ++c) {
    const Block* block = experiment.layout().find(c, "bias");
    if (!block) continue;
    const double distance =
        cv::sum(experiment.nominal(c).depth_mm)[0] / std::max(1, cv::countNonZero(experiment.nominal(c).depth_mm));
    for (int i = block->offset; i < block->offset + block->size; ++i) {
      if (std::isnan(data[i])) continue;
      errors.push_back(std::abs(data[i]));
      ratios.push_back((distance + data[i]) / distance);
    }
  }
  if (errors.empty()) return result;
  double cells = 0;
  for (const auto& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != "drop-out") continue;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (!std::isnan(data[i])) result.known_share += std::pow(std::cos(data[i]), 2), cells += 1;
  }
  if (cells > 0) result.known_share /= cells;
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
  result.median_error_mm = errors[errors.size() / 2];
  result.median_ratio = ratios[ratios.size() / 2];
  return result;
}

/// Throws where model and recording cannot be about the same instrument: no effect is to be named then.
void check_registration(const Experiment& experiment, const StatVector& data, const SensorModel& model) {
  const Plausibility seen = plausibility(experiment, data);
  double distance = 0;
  for (int c = 0; c < experiment.layout().captures; ++c)
    distance += cv::sum(experiment.nominal(c).depth_mm)[0] /
                std::max(1, cv::countNonZero(experiment.nominal(c).depth_mm)) / experiment.layout().captures;
  if (seen.median_error_mm > 0.03 * distance) {
    const std::string unit = seen.median_ratio < 0.01 || seen.median_ratio > 50
                                 ? " Are the depths or the poses in another unit (metres for millimetres)?"
                                 : " Are the poses or the camera those of this recording?";
    throw Error(
        fmt::format("Model and recording do not describe the same scene: half of the measured depths are more "
                    "than {:.3g} mm from where the targets are said to stand ({:.3g} mm away).{} No effect is "
                    "looked for before this is mended.",
                    seen.median_error_mm, distance, unit));
  }
  // Holes on the other side of every object: the projector stands there. Compared on drop-outs alone.
  const auto projector = model.projector_known ? std::optional<Vector3>(model.projector_xyz_mm)
                                               : experiment.forward().set().sensor.projector();
  if (!projector || std::abs(projector->x()) < 1) return;
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  if (std::none_of(model.effects.begin(), model.effects.end(), [&](const EffectInstance& e) {
        const auto& d = e.declaration(catalogue);
        return d.needs.baseline && d.reason.has_value();
      }))
    return;
  SensorModel as_given = model, mirrored = model;
  for (SensorModel* m : {&as_given, &mirrored}) {
    m->projector_from = Given::written;
    m->projector_known = true;
    m->projector_xyz_mm = *projector;
  }
  mirrored.projector_xyz_mm = -*projector;
  const auto simulated =
      experiment.simulate({Trial{as_given, {}, 11, Part::all, 1, true}, Trial{mirrored, {}, 11, Part::all, 1, true}});
  double apart[2] = {0, 0}, differ = 0;
  for (const auto& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != "drop-out") continue;
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      if (std::isnan(data[i]) || std::isnan(simulated[0][i]) || std::isnan(simulated[1][i])) continue;
      for (int k = 0; k < 2; ++k) apart[k] += std::pow(data[i] - simulated[k][i], 2);
      differ += std::pow(simulated[0][i] - simulated[1][i], 2);
    }
  }
  // Right side: apart[1] - apart[0] is about +differ; wrong side: about -differ.
  if (differ > 5 && apart[0] - apart[1] > 0.5 * differ)
    throw Error(
        "The measured shadows lie on the other side of the objects than this model predicts: is the sign of the "
        "baseline (the projector's x) wrong? No effect is looked for before this is mended.");
}

std::vector<std::string> lacking_data(const Experiment& experiment, const StatVector& data) {
  std::vector<std::string> lacking;
  const Layout& layout = experiment.layout();
  const int train = static_cast<int>(std::count(layout.train.begin(), layout.train.end(), true));
  if (train == 0) lacking.push_back("captures in the split \"train\" to fit on");
  if (train == layout.captures)
    lacking.push_back(
        "captures in the split \"test\" to hold out: an effect is only named if it also explains captures that it was "
        "not fitted to");
  if (plausibility(experiment, data).known_share < 0.15)
    lacking.push_back("captures with depth: fewer than 15 % of the places where the targets are have any");
  if (!experiment.repeats())
    lacking.push_back("several frames of a target (at least 3): noise cannot be told from shape in single frames");
  return lacking;
}

CandidateReport report_of(const Refined& refined, int null_count) {
  CandidateReport report;
  report.effect = refined.effect;
  report.id = refined.id;
  report.p = refined.p;
  report.null_count = null_count;
  report.evidence = refined.test_gain;
  report.train_gain = refined.train_gain;
  return report;
}

void fill_parameters(CandidateReport& report, const SensorModel& model, const Fit& fit) {
  const EffectInstance* instance = model.find(report.id);
  if (!instance) return;
  report.parameters.clear();
  for (const auto& parameter : fit.parameters)
    if (parameter.id == report.id) report.parameters.emplace_back(parameter, instance->values.at(parameter.name));
}

}  // namespace

Diagnosis diagnose(const ForwardModel& forward, const Experiment::FrameReader& reader, const SensorModel& model,
                   SimulationCache& cache, const DiagnosisOptions& options) {
  const auto began = std::chrono::steady_clock::now();
  Diagnosis diagnosis;
  diagnosis.improved = model;
  const Experiment experiment(forward, model, cache);
  const Layout& layout = experiment.layout();
  const Measurement measured = experiment.measure(reader, diagnosis.warnings);
  const StatVector& data = measured.all;
  Evidence evidence;
  evidence.lacking = lacking_data(experiment, data);
  const Hypotheses all = make_hypotheses(forward, model);
  diagnosis.untested = all.untested;
  for (const auto& [id, reason] : forward.inactive(model))
    diagnosis.warnings.push_back("the model's " + id + " is not active on this recording: " + reason);
  if (!evidence.lacking.empty()) {
    diagnosis.verdict = judge(evidence);
    put_into_words(diagnosis, forward.catalogue(), evidence.lacking);
    return diagnosis;
  }
  check_registration(experiment, data, model);

  const RegistrationPrior prior = registration_prior(forward.set(), experiment.nominal(0).camera);
  const auto motions = scene_motions(experiment, model, prior);
  RungOptions rung_options;
  rung_options.simulations = options.simulations;
  rung_options.seed = options.seed * 100000;
  std::vector<Rung> rungs;
  rungs.push_back(fit_rung(experiment, motions, measured, model, {}, rung_options));
  const auto signatures = make_signatures(experiment, signature_model(model, rungs[0].model, forward.catalogue()), all,
                                          SignatureOptions{.seed = options.seed * 7001});

  SearchOptions search_options;
  std::vector<std::string> added{""};
  for (int step = 0; step < options.most_effects; ++step) {
    const Rung& rung = rungs.back();
    Hypotheses left = all;
    std::vector<Signature> left_signatures;
    std::vector<int> index(all.tested.size(), -1);
    left.tested.clear();
    for (std::size_t h = 0; h < all.tested.size(); ++h)
      if (std::find(added.begin(), added.end(), all.tested[h].effect) == added.end()) {
        index[h] = static_cast<int>(left.tested.size());
        left.tested.push_back(all.tested[h]);
      }
    for (const auto& signature : signatures)
      if (index[signature.hypothesis] >= 0) {
        left_signatures.push_back(signature);
        left_signatures.back().hypothesis = index[signature.hypothesis];
      }
    const SearchResult found = search(experiment, motions, rung, measured, left, left_signatures, search_options);
    if (step == 0)
      for (std::size_t h = 0; h < left.tested.size(); ++h)
        diagnosis.ranking.push_back(
            {left.tested[h].effect, found.linear[h].gain / rung.dispersion, found.prices[h], found.p_values[h]});
    const Refined* best = found.accepted(search_options);
    if (std::getenv("BINRIG_TRACE")) {
      fmt::print(stderr, "step {} gate {:.1f} dispersion {:.2f}\n", step, found.gate, rung.dispersion);
      for (const auto& r : found.refined)
        fmt::print(stderr, "  {} linear {:.1f} price {:.1f} train {:.1f} test {:.1f}\n", r.effect, r.linear_gain,
                   r.price, r.train_gain, r.test_gain);
    }
    if (!best) break;
    CandidateReport report = report_of(*best, static_cast<int>(rung.nulls.size()));
    Evidence::Accepted accepted{best->effect, false, true, {}};
    for (const auto& hypothesis : all.tested)
      if (hypothesis.effect == best->effect) accepted.map = hypothesis.declaration->per_unit_map;
    for (const auto& rival : found.refined)
      if (&rival != best && rival.test_gain > search_options.least_test_gain && confounded(rung, *best, rival))
        accepted.rivals.push_back(rival.effect);
    report.confounded_with = accepted.rivals;
    diagnosis.candidates.push_back(report);
    evidence.accepted.push_back(accepted);
    added.push_back(best->effect);
    RungOptions again = rung_options;
    again.simulations = std::max(16, options.simulations / 2);
    // What the model had before was bent to make up for what was missing: it begins anew where the user put it.
    SensorModel start = best->model;
    for (auto& instance : start.effects)
      if (const EffectInstance* given = model.find(instance.id)) instance.values = given->values;
    const auto offsets = rung.offsets;
    rungs.push_back(fit_rung(experiment, motions, measured, start, offsets, again));
    // The gain was computed with the scale of the rung before; the ladder judges by the last one's. An addition that
    // does not lower the held-out score there is no improvement, whatever its gain said.
    const auto judged = scores(layout, rungs.back(), data, rungs);
    const double before = judged[judged.size() - 2].heldout, after = judged.back().heldout;
    if (after >= before) {
      diagnosis.warnings.push_back(
          fmt::format("{} was tried next and taken out again: with it the error on captures held out did not fall "
                      "({:.3g} to {:.3g})",
                      best->effect, before, after));
      rungs.pop_back();
      diagnosis.candidates.pop_back();
      evidence.accepted.pop_back();
      added.pop_back();
      break;
    }
  }

  // Backward: what was needed on the way may be superfluous beside what was added later. The last one just proved
  // itself.
  std::vector<std::string> removed(rungs.size());
  for (std::size_t k = 0; k + 1 < diagnosis.candidates.size();) {
    SensorModel without = rungs.back().model;
    const std::string id = diagnosis.candidates[k].id;
    std::erase_if(without.effects, [&](const EffectInstance& e) { return e.id == id; });
    RungOptions again = rung_options;
    again.simulations = 8;  // only their mean is looked at
    again.passes = 1;
    again.iterations = 4;
    std::vector<Rung> pair{rungs.back(), fit_rung(experiment, motions, measured, without, rungs.back().offsets, again)};
    const auto judged = scores(layout, pair[0], data, pair);
    if (judged[1].heldout > judged[0].heldout) {
      ++k;
      continue;
    }
    diagnosis.warnings.push_back(fmt::format(
        "{} was added and, with what came after it, taken out again: without it the error on captures held out is no "
        "larger ({:.3g} with it, {:.3g} without)",
        diagnosis.candidates[k].effect, judged[0].heldout, judged[1].heldout));
    rungs.push_back(std::move(pair[1]));
    added.push_back("");
    removed.push_back(diagnosis.candidates[k].effect);
    diagnosis.candidates.erase(diagnosis.candidates.begin() + static_cast<long>(k));
    evidence.accepted.erase(evidence.accepted.begin() + static_cast<long>(k));
  }

  const Rung& last = rungs.back();
  const auto ladder = scores(layout, last, data, rungs);
  for (std::size_t k = 0; k < rungs.size(); ++k)
    diagnosis.ladder.push_back({static_cast<int>(k), added[k], removed[k], rungs[k].model, ladder[k]});
  std::set<std::string> unexplained;
  for (const auto& fit : goodness_of_fit(layout, last)) {
    if (std::getenv("BINRIG_TRACE"))
      fmt::print(stderr, "goodness {:14} {} {:.3f} excess {:.3f} +- {:.3f}{}\n", segments()[fit.segment].name,
                 fit.train ? "train" : "test", fit.ratio, fit.excess, fit.spread, fit.significant() ? " *" : "");
    if (!fit.significant()) continue;
    const auto& segment = segments()[fit.segment];
    if (unexplained.insert(segment.name).second) {
      Unexplained entry;
      entry.channel = segment.group;
      entry.segment = segment.name;
      entry.ratio = fit.ratio;
      diagnosis.unexplained.push_back(entry);
    }
  }
  evidence.unexplained_segments.assign(unexplained.begin(), unexplained.end());
  diagnosis.verdict = judge(evidence);
  screen(experiment, last, data, diagnosis.unexplained);

  diagnosis.present = present_parameters(model, last, forward.catalogue());
  diagnosis.improved = last.model;
  write_intervals(diagnosis.improved, last.fit, last.dispersion, options.provenance);
  for (std::size_t k = 0; k < diagnosis.candidates.size(); ++k) {
    CandidateReport& candidate = diagnosis.candidates[k];
    fill_parameters(candidate, diagnosis.improved, last.fit);
    const auto step = static_cast<std::size_t>(std::find(added.begin(), added.end(), candidate.effect) - added.begin());
    candidate.heldout_after = ladder[step].heldout;
    for (auto& instance : diagnosis.improved.effects)
      if (instance.id == candidate.id)
        instance.provenance = fmt::format(
            "added by diagnosis: held-out score {:.3g} -> {:.3g} (gain of chi-square {:.3g} "
            "on captures not fitted to); {}",
            ladder[step - 1].heldout, ladder[step].heldout, candidate.evidence, options.provenance);
  }
  for (int c = 0; c < layout.captures; ++c) {
    const Block* block = layout.find(c, "bias");
    if (!block) continue;
    Diagnosis::Maps maps;
    maps.capture = experiment.captures()[c].key() + " " + experiment.captures()[c].name;
    maps.before.create(block->rows, block->cols, CV_32F);
    maps.after.create(block->rows, block->cols, CV_32F);
    maps.valid.create(block->rows, block->cols, CV_8U);
    for (int i = 0; i < block->size; ++i) {
      const float d = data[block->offset + i], first = rungs[0].standard.mean()[block->offset + i],
                  second = last.standard.mean()[block->offset + i];
      const bool known = !std::isnan(d) && !std::isnan(first) && !std::isnan(second);
      maps.valid.ptr<std::uint8_t>()[i] = known ? 255 : 0;
      maps.before.ptr<float>()[i] = known ? d - first : 0;
      maps.after.ptr<float>()[i] = known ? d - second : 0;
    }
    diagnosis.maps.push_back(maps);
  }
  put_into_words(diagnosis, forward.catalogue(), evidence.lacking);
  diagnosis.simulations = experiment.simulated();
  diagnosis.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  return diagnosis;
}

}  // namespace binrig
