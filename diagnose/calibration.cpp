#include "diagnose/calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include <fmt/format.h>

#include "compare/probability.h"
#include "core/error.h"
#include "diagnose/comb.h"
#include "diagnose/edge_registration.h"
#include "diagnose/last_step.h"
#include "diagnose/profile.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double near_enough = 3;  // standard deviations: so far the last step is as straight as its slopes
constexpr double chi_95 = 3.84;
const std::string unmoved = "nothing in this recording moves with it";
const std::string looks_the_same = "targets that stand elsewhere look the same, and nobody knows where they stand";

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
    constexpr int most_rounds = 3;
    constexpr double explains = 1.05;  // dispersion
    constexpr double wrong = 4;        // times its own randomness: a model so far off is not worth the last digit
    Calibration result;
    result.rung = fit_rung(experiment_, motions_, measured_, start_, {}, rung_options_);
    comb_steps(experiment_, motions_, measured_, start_, rung_options_, result.rung);
    first_ = result.rung.fit.parameters;
    if (result.rung.dispersion <= explains)
      register_by_edges(experiment_, motions_, measured_, rung_options_, result.rung);
    for (int round = 0;; ++round) {
      last_ = last_step(experiment_, motions_, result.rung, first_, series_, rung_options_.seed);
      model_ = last_.model;
      result.converged = last_.length < near_enough;
      if (result.converged || round + 1 == (result.rung.dispersion > wrong ? 2 : most_rounds)) break;
      result.rung = made_anew(experiment_, motions_, measured_, model_, result.rung.offsets, rung_options_, first_);
    }
    result.dispersion = result.rung.dispersion;
    report(result.rung);
    widen(result.rung);
    bound_strengths(result.rung);
    choose_rough_strengths(result.rung);
    for (const auto& [id, spec] : steps_)
      if (!entry_of(id, spec->name).determined()) choose_step(result.rung, id, *spec);
    write();
    result.model = model_;
    result.parameters = parameters_;
    return result;
  }

 private:
  CalibratedParameter& entry_of(const std::string& id, const std::string& name) {
    return *std::find_if(parameters_.begin(), parameters_.end(),
                         [&](const CalibratedParameter& p) { return p.id == id && p.name == name; });
  }
  const CalibratedParameter& entry_of(const std::string& id, const std::string& name) const {
    return const_cast<Calibrator*>(this)->entry_of(id, name);
  }

  void report(const Rung& rung) {
    const int n = static_cast<int>(first_.size());
    const double t = student_threshold(0.05, last_.freedom);
    for (int p = 0; p < n; ++p) {
      const FitParameter& parameter = first_[p];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const double sd = std::sqrt(std::max(0.0, last_.covariance(p, p)));
      entry.value = parameter.natural(last_.value[p]);
      entry.narrowing = std::min(1.0, sd / prior_deviation(parameter));
      if (silent(rung.fit.slopes[p])) {
        entry.reason = unmoved;
      } else if (last_.information(p, p) == 0) {
        entry.reason = "this recording says hardly anything about it";
      } else if (entry.narrowing >= narrow_enough) {
        int rival = -1;
        double closest = 0.9;
        for (int q = 0; q < n; ++q) {
          const double c =
              std::abs(last_.covariance(p, q)) / std::sqrt(last_.covariance(p, p) * last_.covariance(q, q));
          if (q != p && c > closest) closest = c, rival = q;
        }
        entry.reason = rival < 0 ? "this recording says hardly anything about it"
                                 : fmt::format("only together with {}.{}", first_[rival].id, first_[rival].name);
      } else if (!poses_known_ && share_beyond_places(layout_, last_, p) < 0.1) {
        entry.reason = looks_the_same;
      } else if (parameter.circular) {
        entry.ci95 = {{entry.value - t * sd, entry.value + t * sd}};
      } else {
        entry.ci95 = {{parameter.natural(last_.value[p] - t * sd), parameter.natural(last_.value[p] + t * sd)}};
      }
    }
  }

  /// Thresholds and widths move pixel after pixel: between two of them nothing changes, and a slope taken over many
  /// says nothing of that. An interval reaches at least to where chi has risen by half of what its end stands for (by
  /// less than all, since the other parameters stay).
  void widen(const Rung& rung) {
    constexpr int doublings = 6;
    for (const FitParameter& parameter : first_) {
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      if (!entry.determined() || parameter.circular) continue;
      const double at = parameter.scaled(entry.value), limit = 0.5 * chi_95 * rung.dispersion;
      const double least = chi_with(rung, entry.id, entry.name, entry.value);
      for (double& end : *entry.ci95) {
        double reach = parameter.scaled(end) - at;
        for (int k = 0; k < doublings && end > parameter.lower && end < parameter.upper; ++k, reach *= 2) {
          end = parameter.natural(at + reach);
          if (chi_with(rung, entry.id, entry.name, end) > least + limit) break;
        }
      }
    }
  }

  /// Effects fade away long before their strength is nothing. There slopes say nothing, or how far a strength is above
  /// that, and not that nothing would do as well: values are tried, the other parameters following by their slopes.
  void bound_strengths(const Rung& rung) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t p = 0; p < first_.size(); ++p) {
      const FitParameter& parameter = first_[p];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const EffectDeclaration& declaration = model_.find(entry.id)->declaration(catalogue_);
      const ParameterSpec* spec = declaration.parameter(entry.name);
      if (entry.name != declaration.amplitude || !spec->neutral || entry.reason == unmoved ||
          entry.reason == looks_the_same)
        continue;  // what poses would cost in chi says nothing of it
      const double neutral = *spec->neutral, strong = spec->either_sign && entry.value < 0 ? -spec->typical_high
                                                      : neutral < spec->typical_low        ? spec->typical_high
                                                                                           : spec->typical_low;
      if (entry.determined() && (*entry.ci95)[0] < neutral && neutral < (*entry.ci95)[1]) continue;
      if (!std::isfinite(least)) least = refit(rung, model_, -1).chi;
      const auto at = [&](double value) {
        SensorModel changed = model_;
        value_in(changed, entry.id, entry.name).value = value;
        Fit fit = refit(rung, changed, static_cast<int>(p));
        if (tracing())
          fmt::print(stderr, "{}.{} = {:.4g}: chi + {:.1f}\n", entry.id, entry.name, value, fit.chi - least);
        return fit;
      };
      const double limit = least + chi_95 * rung.dispersion;
      const Fit without = at(neutral);
      if (without.chi > limit) continue;
      double end = entry.determined() ? (*entry.ci95)[strong > neutral ? 1 : 0] : entry.value;
      if (!entry.determined()) {
        if (at(strong).chi < limit) continue;
        double too_far = strong;
        for (int halving = 0; halving < 5; ++halving) {
          const double middle = 0.5 * (end + too_far);
          (at(middle).chi < limit ? end : too_far) = middle;
        }
        end = too_far;
      }
      entry.ci95 = {{std::min(neutral, end), std::max(neutral, end)}};
      entry.reason.clear();
      entry.narrowing = std::min(1.0, std::abs(end - neutral) / std::abs(strong - neutral));
      if (without.chi < least + rung.dispersion) adopt(without, static_cast<int>(p), neutral);
    }
  }

  /// A fit with a parameter at a value is better than the one so far: the others' intervals go along, and grow by what
  /// two simulations scatter.
  void adopt(const Fit& fit, int p, double value) {
    for (std::size_t q = 0; q < fit.parameters.size(); ++q) {
      const FitParameter& parameter = fit.parameters[q];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const double before = parameter.circular ? entry.value : parameter.scaled(entry.value);
      const double after = fit.value[static_cast<int>(q)];
      entry.value = parameter.natural(after);
      for (double& end : *entry.ci95) {
        const double half = std::sqrt(1.5) * ((parameter.circular ? end : parameter.scaled(end)) - before);
        end = parameter.circular ? entry.value + half : parameter.natural(after + half);
      }
    }
    entry_of(first_[p].id, first_[p].name).value = value;
    model_ = fit.model;
  }

  /// All parameters that are determined, but one, fitted again to all frames.
  Fit refit(const Rung& rung, const SensorModel& model, int without) const {
    std::vector<FitParameter> parameters;
    Fit nearby;
    for (std::size_t p = 0; p < first_.size(); ++p) {
      if (static_cast<int>(p) == without || !entry_of(first_[p].id, first_[p].name).determined()) continue;
      parameters.push_back(first_[p]);
      nearby.slopes.push_back(rung.fit.slopes[p]);
      nearby.seed_slopes.push_back(rung.fit.seed_slopes[p]);
    }
    FitOptions options = quick(rung);
    options.nearby = &nearby;
    options.iterations = 0;
    return fit_model(experiment_, rung.standard, last_.metric, rung.data, model, parameters, rung.offsets, options);
  }

  FitOptions quick(const Rung& rung) const {
    FitOptions options;
    options.seed = rung_options_.seed + 500;
    options.place = last_.place;
    return options;
  }

  double chi_with(const Rung& rung, const std::string& id, const std::string& name, double value) const {
    SensorModel changed = model_;
    value_in(changed, id, name).value = value;
    return fit_model(experiment_, rung.standard, last_.metric, rung.data, changed, {}, rung.offsets, quick(rung)).chi;
  }

  /// Tries values about the best one so far, near and far, until none is better, and then further out until both sides
  /// are ruled out. Where nothing typical is ruled out on either side, that is the answer.
  void explore(Profile& profile, const std::string& id, const ParameterSpec& spec, double unit,
               const std::vector<double>& reaches) const {
    constexpr int most_moves = 4, most_doublings = 6;
    const bool logarithmic = spec.log_scaled && spec.kind != ParameterKind::integer;
    const auto ask = [&](double from, double reach) {
      double at = logarithmic && from > 0 ? from * std::exp(reach * unit) : from + reach * unit;
      at = std::clamp(spec.kind == ParameterKind::integer ? std::round(at) : at, spec.lower, spec.upper);
      SensorModel changed = model_;
      value_in(changed, id, spec.name).value = at;
      const double chi = profile.ask(at, changed);
      if (tracing()) fmt::print(stderr, "{}.{} = {:.5g}: chi {:.1f}\n", id, spec.name, at, chi);
      return at;
    };
    double middle = ask(model_.find(id)->value(spec.name), 0);
    for (int moves = 0; moves < most_moves; ++moves) {
      for (const double reach : reaches) ask(middle, reach), ask(middle, -reach);
      if (profile.best() == middle) break;
      middle = profile.best();
    }
    double reach = reaches.back();
    for (int k = 0; k < most_doublings && (profile.open_below() || profile.open_above()); ++k) {
      const bool below = profile.open_below(), above = profile.open_above();
      if (below && above && k == 2) {
        for (const double far : {spec.typical_low, spec.typical_high}) ask(far, 0);
        break;
      }
      reach *= 2;
      if (below) ask(middle, -reach);
      if (above) ask(middle, reach);
    }
  }

  /// The best value tried, and where it lies for certain.
  void take(const Profile& profile, const std::string& id, const ParameterSpec& spec) {
    CalibratedParameter& entry = entry_of(id, spec.name);
    if (profile.open_below() && profile.open_above()) {
      entry.ci95.reset();
      entry.reason = "this recording says hardly anything about it";
      return;
    }
    value_in(model_, id, spec.name).value = entry.value = profile.best();
    auto [low, high] = profile.interval(spec.lower, spec.upper);
    if (spec.kind == ParameterKind::integer) {  // the nearest that are ruled out do not belong to it
      low = std::min(low + (profile.open_below() ? 0 : 1), entry.value);
      high = std::max(high - (profile.open_above() ? 0 : 1), entry.value);
    }
    if (tracing())
      fmt::print(stderr, "{}.{}: {:.5g} ({:.5g} .. {:.5g}), chi may rise by {:.1f}\n", id, spec.name, entry.value, low,
                 high, profile.limit());
    entry.ci95 = {{low, high}};
    entry.narrowing = std::min(1.0, (high - low) / std::max(std::abs(spec.typical_high - spec.typical_low), 1e-12));
  }

  /// Values between which nothing moves smoothly are tried one by one: whole numbers by ones, others by factors.
  void choose_step(const Rung& rung, const std::string& id, const ParameterSpec& spec) {
    Profile profile(experiment_, motions_, rung, last_.metric, last_.place, false, rung_options_.seed + 500);
    const double scale = std::abs(spec.typical_high - spec.typical_low);
    if (spec.kind == ParameterKind::integer)
      explore(profile, id, spec, 1, {1});
    else
      explore(profile, id, spec, spec.log_scaled ? 0.004 : 0.004 * scale, {1, 4, 15});
    take(profile, id, spec);
  }

  /// What shows the scene from elsewhere moves edges pixel after pixel: chi is rough along its strength, and slopes end
  /// in one of many valleys and promise too much there.
  void choose_rough_strengths(const Rung& rung) {
    for (const FitParameter& parameter : first_) {
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const EffectDeclaration& declaration = model_.find(entry.id)->declaration(catalogue_);
      if (!entry.determined() || !declaration.may_clear || entry.name != declaration.amplitude) continue;
      const ParameterSpec& spec = *declaration.parameter(entry.name);
      Profile profile(experiment_, motions_, rung, last_.metric, last_.place, true, rung_options_.seed + 500);
      const double deviation = (parameter.scaled((*entry.ci95)[1]) - parameter.scaled((*entry.ci95)[0])) / 4;
      explore(profile, entry.id, spec, deviation, {0.5, 1, 2, 4});
      take(profile, entry.id, spec);
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
