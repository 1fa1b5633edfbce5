// The last step of a calibration and what it knows: parameters fitted once more against the mean of the model's own
// simulations, with the covariance of that very step.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnose/rung.h"

namespace binrig {

inline constexpr double narrow_enough = 0.6;  ///< of the prior's standard deviation: below, the recording has spoken
inline constexpr int short_frames = 3;        ///< of a capture while derivatives are taken

/// Standard deviation of what is known beforehand, on the scale of the fit.
double prior_deviation(const FitParameter& parameter);
/// Nothing moves with the parameter whose derivative this is.
bool silent(const Whitened& slope);

struct LastStep {
  SensorModel model;  ///< the rung's, with the step taken
  Eigen::VectorXd value, step;
  Eigen::MatrixXd information;  ///< 0 in rows and columns of parameters of which the data say nothing
  /// Of value: scatter among simulations and priors together, and the step itself where it is longer than chance makes
  /// it (length^2 over n + 3 sqrt(2 n) of n parameters): slopes do not hold over that.
  Eigen::MatrixXd covariance;
  double freedom = 1;         ///< of its scatter
  double length = 0;          ///< of the step, in standard deviations of its direction, itself not counted
  std::vector<double> place;  ///< of the motions, in the rung
  std::vector<NuisanceRow> rows;
  Metric metric;  ///< of the motions alone, on train
  /// By parameter: change of y per unit of its scale. 0 in segments in which it is mostly noise, and in the blocks
  /// whose slopes are no slopes (see last_step).
  std::vector<Whitened> jacobian;

  /// Half of the 95 % intervals of value, on the scale of the fit (Student's t with `freedom`).
  Eigen::VectorXd half_interval() const;
};

/// The model where `share` of the step leads. `priors`: those that it was made with.
SensorModel stepped(const LastStep& step, const std::vector<FitParameter>& priors, double share);

/// `priors`: the rung's parameters with their first priors. `series`: captures from power-on are not shortened.
/// Derivatives are taken to both sides. A block (a segment of a capture) in which a parameter's derivatives to the two
/// sides differ so much that its slope is wrong by half a standard deviation of y, over a standard deviation of the
/// parameter, counts for no parameter; unless such blocks hold half of what is known of it, or it belongs to a mask.
/// Throws what simulating throws.
LastStep last_step(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                   const std::vector<FitParameter>& priors, bool series, std::uint64_t seed);

/// Share of what the recording says about parameter p that is left if nothing is known of the targets' places.
double share_beyond_places(const Layout& layout, const LastStep& step, int p);

}  // namespace binrig
