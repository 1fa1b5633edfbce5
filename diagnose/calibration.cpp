#include "diagnose/calibration.h"

#include <algorithm>
#include <map>

#include <fmt/format.h>

#include "core/error.h"
#include "diagnose/comb.h"
#include "diagnose/edge_registration.h"
#include "diagnose/hypotheses.h"
#include "diagnose/intervals.h"
#include "diagnose/last_step.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double near_enough = 3;  // standard deviations: so far the last step is as straight as its slopes
constexpr double explains = 1.05;  // dispersion
constexpr double wrong = 4;        // times its own randomness: a model so far off is not worth the last digit

bool names(const std::vector<std::string>& list, const std::string& id, const std::string& parameter) {
  return std::any_of(list.begin(), list.end(), [&](const auto& n) { return n == id || n == id + "." + parameter; });
}

void check_names(const std::vector<std::string>& list, const SensorModel& model, const EffectCatalogue& catalogue) {
  std::vector<std::string> known;
  for (const auto& instance : model.effects) {
    known.push_back(instance.id);
    for (const auto& spec : instance.declaration(catalogue).parameters) known.push_back(instance.id + "." + spec.name);
  }
  for (const auto& name : list)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw Error(fmt::format("the model has no parameter {}; it has {}", name, fmt::join(known, ", ")));
}

class Calibrator {
 public:
  Calibrator(const Experiment& experiment, const Measurement& measured, const SensorModel& start,
             const CalibrationOptions& options)
      : experiment_(experiment),
        layout_(experiment.layout()),
        catalogue_(experiment.forward().catalogue()),
        measured_(measured),
        start_(start),
        options_(options) {
    check_names(options.fixed, start, catalogue_);
    check_names(options.only, start, catalogue_);
    std::map<std::string, std::string> inactive;
    for (const auto& [id, why] : experiment.forward().inactive(start)) inactive[id] = why;
    for (const auto& instance : start.effects)
      for (const auto& spec : instance.declaration(catalogue_).parameters) {
        const bool wanted = is_fitted(options, instance.id, spec.name) && spec.lower < spec.upper;
        const bool acts = !inactive.contains(instance.id);
        if (!wanted || !acts) rung_options_.fixed.push_back(instance.id + "." + spec.name);
        if (!wanted) continue;
        CalibratedParameter entry{instance.id, spec.name, spec.unit, instance.value(spec.name)};
        entry.value = entry.before;
        if (!acts) entry.reason = inactive[instance.id];
        parameters_.push_back(entry);
        if (acts && (spec.kind == ParameterKind::integer || !spec.interpolate)) steps_.emplace_back(instance.id, &spec);
      }
    if (parameters_.empty()) throw Error("no parameter is left to fit");
    const RegistrationPrior prior = registration_prior(experiment.forward().set(), experiment.nominal(0).camera);
    // What a series shows needs the series.
    series_ = needs_whole_series(start, catalogue_);
    poses_known_ = prior.poses_known;
    motions_ = scene_motions(experiment, start, prior);
    rung_options_.simulations = options.simulations;
    rung_options_.pose_draws = options.simulations;
    rung_options_.passes = options.passes;
    rung_options_.iterations = options.iterations;
    rung_options_.scan_all_ranges = true;
    rung_options_.seed = options.seed * 100000;
  }

  Calibration run() {
    Calibration result;
    result.rung = fit_rung(experiment_, motions_, measured_, start_, {}, rung_options_);
    comb_steps(experiment_, motions_, measured_, start_, options_.seen, rung_options_, result.rung);
    try_given_tones(result.rung);
    first_ = result.rung.fit.parameters;
    if (result.rung.dispersion <= explains)
      register_by_edges(experiment_, motions_, measured_, rung_options_, result.rung);
    result.converged = take_last_steps(result.rung);
    model_ = last_.model;
    result.dispersion = result.rung.dispersion;
    const LastFit last{experiment_, motions_, result.rung, last_, first_, poses_known_, rung_options_.seed};
    find_intervals(last, steps_, model_, parameters_);
    write();
    result.model = model_;
    result.parameters = parameters_;
    return result;
  }

 private:
  /// While the noise is still wrong, the frequency of a ring in its spectrum is sought far away. With the noise as it is
  /// now the fit is begun once more where the model file has such an effect, and kept if that is better.
  void try_given_tones(Rung& rung) const {
    SensorModel as_given = rung.model;
    bool any = false;
    for (const EffectInstance& instance : start_.effects) {
      const EffectDeclaration& declaration = instance.declaration(catalogue_);
      if (!has_tone(declaration)) continue;
      for (const auto& spec : declaration.parameters)
        if (is_fitted(options_, instance.id, spec.name))
          value_in(as_given, instance.id, spec.name).value = instance.value(spec.name), any = true;
    }
    if (!any) return;
    const Metric metric(layout_, Part::train, motion_rows(layout_, rung.standard, motions_));
    FitOptions options;
    options.seed = rung_options_.seed + 600;
    options.place.assign(motions_.size(), 0);
    options.motions = &motions_;
    const auto fit = [&](const SensorModel& model) {
      return fit_model(experiment_, rung.standard, metric, rung.data, model, rung.fit.parameters, {}, options);
    };
    const Fit now = fit(rung.model), other = fit(as_given);
    if (tracing()) fmt::print(stderr, "chi {:.1f}, from the frequencies given {:.1f}\n", now.chi, other.chi);
    constexpr double two_sigma = 4;  // of chi, in units of its mean square
    if (now.chi - other.chi < two_sigma * rung.dispersion) return;
    RungOptions again = rung_options_;
    again.passes = 1;
    again.scan_all_ranges = false;
    again.narrow = narrow_of(rung.fit.parameters);
    rung = fit_rung(experiment_, motions_, measured_, other.model, {}, again);
  }

  /// Last steps until one is no longer than chance makes it; false if none is. Then nothing says which of all these
  /// values is right, and intervals span them.
  bool take_last_steps(Rung& rung) {
    constexpr int most = 6;
    constexpr double worth_it = 0.001;  // of the proper score, an element: what lowers it by less was the last
    const int allowed = rung.dispersion > wrong ? 1 : 2;
    double gained = 0;
    Eigen::VectorXd begun;
    for (int taken = 0;; ++taken) {
      last_ = last_step(experiment_, motions_, rung, first_, series_, rung_options_.seed);
      if (last_.length < near_enough) return true;
      const Eigen::VectorXd value = last_.value - last_.step;
      if (taken == 0) begun = value;
      if (taken >= allowed && (taken == most || rung.dispersion > explains || gained < worth_it)) {
        last_.covariance += (value - begun) * (value - begun).transpose();
        return false;
      }
      Rung next = made_anew(experiment_, motions_, measured_, last_.model, rung.offsets, rung_options_, first_);
      gained = proper_score(layout_, rung, Part::train) - proper_score(layout_, next, Part::train);
      if (tracing()) fmt::print(stderr, "proper score on train less by {:.5f}\n", gained);
      rung = std::move(next);
    }
  }

  void write() {
    for (const auto& entry : parameters_)
      value_in(model_, entry.id, entry.name) = {entry.value, entry.ci95,
                                                entry.determined()
                                                    ? "fitted: " + options_.provenance
                                                    : "not determined by " + options_.provenance + ": " + entry.reason};
  }

  const Experiment& experiment_;
  const Layout& layout_;
  const EffectCatalogue& catalogue_;
  const Measurement& measured_;
  const SensorModel& start_;
  const CalibrationOptions& options_;
  RungOptions rung_options_;
  std::vector<CalibratedParameter> parameters_;
  std::vector<std::pair<std::string, const ParameterSpec*>> steps_;
  std::vector<SceneMotion> motions_;
  bool poses_known_ = false, series_ = false;

  std::vector<FitParameter> first_;  // priors stand where the user began
  SensorModel model_;
  LastStep last_;
};

}  // namespace

bool is_fitted(const CalibrationOptions& options, const std::string& id, const std::string& parameter) {
  return !names(options.fixed, id, parameter) && (options.only.empty() || names(options.only, id, parameter));
}

Calibration calibrate(const Experiment& experiment, const Measurement& measured, const SensorModel& start,
                      const CalibrationOptions& options) {
  return Calibrator(experiment, measured, start, options).run();
}

}  // namespace binrig
