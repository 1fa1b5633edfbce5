#include "diagnose/diagnose.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <set>

#include <fmt/format.h>
#include <opencv2/core/mat.hpp>

#include "diagnose/capture_by_capture.h"
#include "diagnose/climb.h"
#include "diagnose/intervals.h"
#include "diagnose/last_step.h"
#include "diagnose/mask_fit.h"
#include "diagnose/plausibility.h"
#include "diagnose/score.h"
#include "diagnose/screen.h"
#include "diagnose/step_reader.h"
#include "diagnose/trace.h"
#include "diagnose/where.h"

namespace binrig {
namespace {

void fill_parameters(CandidateReport& report, const SensorModel& model, const Fit& fit,
                     const EffectCatalogue& catalogue) {
  const EffectInstance* instance = model.find(report.id);
  if (!instance) return;
  report.parameters.clear();
  for (const auto& parameter : fit.parameters)
    if (parameter.id == report.id) report.parameters.emplace_back(parameter, instance->values.at(parameter.name));
  for (const auto& spec : instance->declaration(catalogue).parameters) {  // whole numbers, steps, maps
    const bool listed = std::any_of(report.parameters.begin(), report.parameters.end(),
                                    [&](const auto& entry) { return entry.first.name == spec.name; });
    const ParameterValue& value = instance->values.at(spec.name);
    if (listed || (spec.kind != ParameterKind::integer && spec.interpolate && !value.ci95)) continue;
    FitParameter parameter;
    parameter.id = report.id;
    parameter.name = spec.name;
    parameter.unit = spec.unit;
    report.parameters.emplace_back(parameter, value);
  }
}

/// What a climb's last model leaves, and what is to be said of its effects.
class Findings {
 public:
  Findings(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
           const SensorModel& given, const std::string& provenance, Climbed climbed, Diagnosis& diagnosis)
      : experiment_(experiment),
        motions_(motions),
        measured_(measured),
        given_(given),
        provenance_(provenance),
        climbed_(std::move(climbed)),
        diagnosis_(diagnosis),
        catalogue_(experiment.forward().catalogue()) {}

  void write() {
    judge_last();
    report();
    for (std::size_t k = 0; k < diagnosis_.candidates.size(); ++k)
      climbed_.evidence.accepted[k].doubtful = diagnosis_.candidates[k].doubtful();
    diagnosis_.verdict = judge(climbed_.evidence);
  }

 private:
  /// Is anything left that the last model's own randomness does not explain?
  void judge_last() {
    std::set<std::string> unexplained;
    auto fits = goodness_of_fit(experiment_.layout(), climbed_.rungs.back());
    leave_to_train_what_it_never_saw(fits);
    for (const auto& fit : fits) {
      if (tracing())
        fmt::print(stderr, "goodness {:14} {} {:.3f} excess {:.3f} +- {:.3f}{}\n", fit.segment,
                   fit.train ? "train" : "test", fit.ratio, fit.excess, fit.spread, fit.significant() ? " *" : "");
      if (!fit.significant() || !unexplained.insert(fit.segment).second) continue;
      Unexplained entry;
      entry.channel = fit.group;
      entry.segment = fit.segment;
      entry.ratio = fit.ratio;
      if (fit.segment == "intrinsics") entry.shape = wanted_intrinsics();
      diagnosis_.unexplained.push_back(entry);
    }
    climbed_.evidence.unexplained_segments.assign(unexplained.begin(), unexplained.end());
    if (!unexplained.contains("bias") &&
        (mark_what_differs() || bias_goes_with_something(experiment_, climbed_.rungs.back(), measured_.all))) {
      climbed_.evidence.screen_finds_something = true;
      for (const auto& fit : fits)
        if (fit.segment == "bias" && !fit.train) diagnosis_.unexplained.push_back({fit.group, fit.segment, fit.ratio});
    }
    screen(experiment_, climbed_.rungs.back(), measured_.all, diagnosis_.unexplained);
  }

  /// Marks what was added and is wanted otherwise by each capture; to be asked where the bias seems explained, or what
  /// else is missing would pass for contradictions. True if there is any.
  bool mark_what_differs() {
    bool any = false;
    for (CandidateReport& candidate : diagnosis_.candidates) {
      const WantedOtherwise wanted = wanted_otherwise(experiment_.layout(), climbed_.rungs.back(), candidate.id);
      if (tracing())
        fmt::print(stderr, "{} wanted otherwise: {:.0f}, by chance {:.0f} +- {:.1f}\n", candidate.id, wanted.square,
                   wanted.by_chance, wanted.deviation);
      candidate.differs = wanted.significant();
      any = any || candidate.differs;
    }
    return any;
  }

  /// What stands out on captures held out alone may be a mask of which train says too little: no finding.
  void leave_to_train_what_it_never_saw(std::vector<SegmentFit>& fits) {
    const auto stands_out = [&](bool train) {
      return std::any_of(fits.begin(), fits.end(),
                         [&](const SegmentFit& fit) { return fit.train == train && fit.significant(); });
    };
    if (stands_out(true) || !stands_out(false)) return;
    const auto mask = mask_that_may_stand_elsewhere(experiment_, motions_, measured_, given_, climbed_.options,
                                                    climbed_.rungs.back());
    if (!mask) return;
    std::string captures;
    for (const int c : captures_that_stand_out(experiment_.layout(), climbed_.rungs.back()))
      if (!experiment_.layout().train[c]) captures += (captures.empty() ? "" : ", ") + capture_name(experiment_, c);
    diagnosis_.warnings.push_back(fmt::format(
        "captures held out show drop-outs that those fitted to say too little of to expect ({}): with {} nearer to "
        "where the model given has it, all captures are as they should be. Record more such targets in the split "
        "train",
        captures, *mask));
    std::erase_if(fits, &SegmentFit::significant);
  }

  /// Where the data want the camera's numbers.
  std::string wanted_intrinsics() const {
    const char* const names[] = {"focal length", "principal point in x", "principal point in y"};
    std::string text;
    for (std::size_t m = 0; m < motions_.size(); ++m)
      if (const SceneMotion& motion = motions_[m]; motion.capture < 0)
        text += fmt::format("{}the {} {:+.2g} px from what the recording says (to {:.2g} px)", text.empty() ? "" : ", ",
                            names[motion.element - 6], climbed_.rungs.back().nuisances[m] * motion.sigma, motion.sigma);
    return text;
  }

  /// Parameters and intervals of a model that something was added to, from one more step.
  void take_last_step(Rung& rung) {
    const LastStep step = last_step(experiment_, motions_, rung, rung.fit.parameters,
                                    needs_whole_series(rung.model, catalogue_), climbed_.options.seed);
    rung.model = step.model;
    rung.fit.value = step.value;
    rung.fit.half_interval = step.half_interval();
    // What simulations rule out below is asked with targets anywhere: that nothing would do as well is no doubt there.
    for (CandidateReport& candidate : diagnosis_.candidates)
      candidate.may_be_nothing =
          may_be_nothing(rung.fit, rung.fit.half_interval, candidate.id, *catalogue_.find(candidate.effect));
    // Where something else is missing, what simulations rule out is no more than what slopes say.
    if (rung.dispersion <= far_off) widen(rung, step);
  }

  /// Intervals of what was added, which slopes alone make too narrow.
  void widen(Rung& rung, const LastStep& step) {
    std::set<std::string> added;
    for (const CandidateReport& candidate : diagnosis_.candidates) added.insert(candidate.id);
    const std::vector<FitParameter> parameters = rung.fit.parameters;
    SensorModel model = rung.model;
    widened_ =
        widened_intervals({experiment_, motions_, rung, step, parameters, false, climbed_.options.seed}, added, model);
    for (std::size_t p = 0; p < parameters.size(); ++p) {
      const double value = model.find(parameters[p].id)->value(parameters[p].name);
      rung.fit.value[static_cast<int>(p)] = parameters[p].circular ? value : parameters[p].scaled(value);
    }
    rung.model = std::move(model);
  }

  void report() {
    Rung& last = climbed_.rungs.back();
    std::vector<const Rung*> rungs;
    for (const Rung& rung : climbed_.rungs) rungs.push_back(&rung);
    const auto ladder = scores(experiment_.layout(), motions_, last, measured_.all, rungs);
    if (!diagnosis_.candidates.empty()) take_last_step(last);
    for (std::size_t k = 0; k < climbed_.rungs.size(); ++k)
      diagnosis_.ladder.push_back(
          {static_cast<int>(k), climbed_.added[k], climbed_.removed[k], climbed_.rungs[k].model, ladder[k]});
    diagnosis_.present = present_parameters(given_, last, catalogue_);
    diagnosis_.improved = last.model;
    write_intervals(diagnosis_.improved, last.fit, last.dispersion, provenance_);
    for (const CalibratedParameter& entry : widened_)
      value_in(diagnosis_.improved, entry.id, entry.name).ci95 = entry.ci95;
    for (CandidateReport& candidate : diagnosis_.candidates) {
      fill_parameters(candidate, diagnosis_.improved, last.fit, catalogue_);
      const auto step = static_cast<std::size_t>(
          std::find(climbed_.added.begin(), climbed_.added.end(), candidate.effect) - climbed_.added.begin());
      candidate.heldout_after = ladder[step].heldout;
      for (auto& instance : diagnosis_.improved.effects) {
        if (instance.id != candidate.id) continue;
        for (auto& [name, value] : instance.values)
          if (value.ci95) value.provenance = provenance_;
        instance.provenance = fmt::format(
            "added by diagnosis: held-out score {:.3g} -> {:.3g} (gain of chi-square {:.3g} "
            "on captures not fitted to); {}",
            ladder[step - 1].heldout, ladder[step].heldout, candidate.evidence, provenance_);
      }
    }
    const Where where(experiment_, motions_, measured_.all, climbed_.rungs.front(), last);
    diagnosis_.maps = where.maps();
    diagnosis_.courses = where.courses();
  }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Measurement& measured_;
  const SensorModel& given_;
  const std::string& provenance_;
  Climbed climbed_;
  Diagnosis& diagnosis_;
  const EffectCatalogue& catalogue_;
  std::vector<CalibratedParameter> widened_;  // of what was added
};

}  // namespace

Diagnosis diagnose(const ForwardModel& forward, const Experiment::FrameReader& reader, const SensorModel& model,
                   SimulationCache& cache, const DiagnosisOptions& options) {
  const auto began = std::chrono::steady_clock::now();
  Diagnosis diagnosis;
  diagnosis.improved = model;
  const Experiment experiment(forward, model, cache);
  StepReader steps(experiment, reader);
  const Measurement measured = experiment.measure(steps.reader(), diagnosis.warnings);
  const Hypotheses all = make_hypotheses(forward, model, steps.seen(model));
  diagnosis.untested = all.untested;
  for (const auto& [id, reason] : forward.inactive(model))
    diagnosis.warnings.push_back("the model's " + id + " is not active on this recording: " + reason);
  const auto lacking = lacking_data(experiment, measured.all);
  if (lacking.empty()) {
    check_registration(experiment, measured.all, model);
    const auto motions =
        scene_motions(experiment, model, registration_prior(forward.set(), experiment.nominal(0).camera));
    Climbed climbed = climb(experiment, motions, measured, model, all, options);
    diagnosis.ranking = std::move(climbed.ranking);
    diagnosis.as_many_as_allowed = climbed.as_many_as_allowed;
    diagnosis.unconfirmed = std::move(climbed.unconfirmed);
    diagnosis.candidates = std::move(climbed.candidates);
    std::move(climbed.warnings.begin(), climbed.warnings.end(), std::back_inserter(diagnosis.warnings));
    Findings(experiment, motions, measured, model, options.provenance, std::move(climbed), diagnosis).write();
  }
  put_into_words(diagnosis, forward.catalogue(), lacking);
  diagnosis.simulations = experiment.simulated();
  diagnosis.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  return diagnosis;
}

}  // namespace binrig
