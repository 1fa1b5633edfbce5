// Parameters fitted by simulating again and again: damped Gauss-Newton on the whitened statistics with common random
// numbers. Nothing is known of a parameter but its declaration.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnose/registration.h"
#include "diagnose/slopes.h"

namespace binrig {

/// A parameter of an effect instance, with the scale on which it is fitted (logarithmic where declared so).
struct FitParameter {
  std::string id, name, unit;
  bool logarithmic = false, circular = false;
  double lower = 0, upper = 0;               ///< natural units
  double prior_centre = 0, prior_sigma = 1;  ///< on the scale of the fit; wide
  double step = 0.1, longest = 0.6;          ///< of derivatives, and of one iteration; on the scale of the fit
  /// A period, a step or a place: where it fits the data, its trace moves smoothly over a small part of it only.
  bool narrow = false;

  double scaled(double value) const;
  double natural(double scaled_value) const;
};

/// The parameter of an instance; `closeness`, if given: how near to a narrow one's best value the model's is, relative
/// to the value for a logarithmic one. The prior is centred on the model's value.
FitParameter fit_parameter(const EffectInstance& instance, const ParameterSpec& spec, double closeness = 0);

/// Throws Error if the model has no such instance.
ParameterValue& value_in(SensorModel& model, const std::string& id, const std::string& name);
/// The model with its fitted parameters at `x`, on the scales of their fits. Throws Error if it lacks one's instance.
SensorModel with_values(SensorModel model, const std::vector<FitParameter>& parameters, const Eigen::VectorXd& x);

/// The continuous parameters of the instances named (all if empty), without narrow ones.
std::vector<FitParameter> fit_parameters(const SensorModel& model, const EffectCatalogue& catalogue,
                                         const std::vector<std::string>& ids = {});

/// Those of them that are.
std::vector<FitParameter> narrow_of(const std::vector<FitParameter>& parameters);

constexpr double far_off = 3;  ///< dispersion beyond which something else is missing, see FitOptions

struct FitOptions {
  int seeds = 2;
  int most_frames = 0;  ///< of Trial
  bool shorten_series = false;
  int iterations =
      5;  ///< slopes are simulated at most so often; 0: derivatives at the start, or steps with those of `nearby`
  double converged = 1;  ///< gain of chi, in units of its mean square, that ends the fit
  /// Ends it, too, as a share of chi, where the dispersion is beyond 3: there something else is missing, and what the
  /// last percents of a fit bend is of no use to who seeks it.
  double converged_far_off = 0;
  Part part = Part::train;
  std::uint64_t seed = 101;
  std::vector<double> place;  ///< of the metric's nuisances in simulations at `offsets`, see Metric::explain
  /// The metric's first nuisances: where given, targets go along to where a model wants them, since what is left of a
  /// large motion in the linear view would hide what a parameter does. Null = they stay.
  const std::vector<SceneMotion>* motions = nullptr;
  /// A fit of the same parameters nearby, under the same standard: begins with its slopes instead of simulating them.
  const struct Fit* nearby = nullptr;
  /// Instances whose whole-number parameters are varied, too, and narrow ones sought: these are fitted with all others
  /// once they are near.
  std::vector<std::string> scan_ids;
  /// Strengths of what touches few captures (masks) are tried far and near where the descent ends, and what moved
  /// nothing is tried far: what moves pixel after pixel has valleys between which slopes do not lead. Only where the
  /// dispersion there, or what most captures leave, is no larger than this; 0 = not at all.
  double probe_within = 0;
  std::vector<std::string> fixed;  ///< parameters of theirs, by id.name, that stay
  /// Of this instance, narrow parameters are sought over the whole typical range, unless it has a phase: a period is
  /// worth nothing with another one's.
  std::string scan_ranges_of;
  bool scan_all_ranges = false;  ///< of all `scan_ids`
};

struct Fit {
  SensorModel model;
  std::vector<Offset> offsets;  ///< where the targets stand with it
  std::vector<double> place;
  std::vector<FitParameter> parameters;  ///< those given, then narrow ones that were sought
  Eigen::VectorXd value;                 ///< on the scale of the fit
  Eigen::MatrixXd precision;             ///< of value, prior included
  /// Standard deviation of the estimates over simulations of the fitted model, each taken for the data: what the
  /// precision does not know of (neighbouring cells that move together). Empty = not known.
  Eigen::VectorXd scatter;
  Eigen::VectorXd half_interval;  ///< half of the 95 % intervals; empty = from precision and scatter
  std::vector<Whitened> slopes;   ///< change of y per unit, shrunk
  SeedSlopes seed_slopes;         ///< the same, as each seed has it, in segments in which it is not mostly noise
  /// Parameters of which the data said nothing when their derivative was last taken (less than four times what their
  /// prior says): they were not simulated again, and stay where the prior holds them.
  std::vector<bool> paused;
  std::vector<StatVector> simulations;  ///< of the model where it ended, one a seed
  Whitened residual;                    ///< what the model and the nuisances leave of the data, compressed
  double chi = 0;         ///< of Metric::explain, without the simulations' own noise, plus the prior's part
  double dispersion = 1;  ///< chi by known statistic, at least 1
  int rounds = 0;
  bool converged = false;
};

/// `data` is Standard::linear of the measurement, of as many frames as `most_frames` leaves. Simulates again and again
/// until chi changes by less than `converged`; every step is the minimum of the damped normal equations within a box of
/// FitParameter::longest and the bounds. Without parameters only the targets are placed (`motions`). Throws what
/// simulating throws.
Fit fit_model(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
              const SensorModel& start, const std::vector<FitParameter>& parameters, const std::vector<Offset>& offsets,
              const FitOptions& options);

/// Half of a parameter's 95 % interval, on the scale of the fit: half_interval if there is one, else from its scatter
/// or its precision (widened by `dispersion`), whichever is wider.
Eigen::VectorXd half_intervals(const Fit& fit, double dispersion);
/// Does the interval of an instance's strength hold the value at which it does nothing? `half`: half of the intervals
/// of all parameters, on the scale of the fit. False if the strength is not fitted, or fitted as a logarithm.
bool may_be_nothing(const Fit& fit, const Eigen::VectorXd& half, const std::string& id,
                    const EffectDeclaration& effect);
/// Writes the fit's values, their intervals and where they are from.
void write_intervals(SensorModel& model, const Fit& fit, double dispersion, const std::string& provenance);

}  // namespace binrig
