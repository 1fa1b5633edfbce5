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
  double freedom = 1;           ///< of its scatter
  double length = 0;            ///< of the step, in standard deviations of its direction, itself not counted
  std::vector<double> place;    ///< of the motions, in the rung
  std::vector<NuisanceRow> rows;
  Metric metric;                   ///< of the motions alone, on train
  std::vector<Whitened> jacobian;  ///< of segments in which it is not mostly noise
};

/// The model where `share` of the step leads. `priors`: those that it was made with.
SensorModel stepped(const LastStep& step, const std::vector<FitParameter>& priors, double share);

/// `priors`: the rung's parameters with their first priors. `series`: captures from power-on are not shortened.
LastStep last_step(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                   const std::vector<FitParameter>& priors, bool series, std::uint64_t seed);

/// Share of what the recording says about parameter p that is left if nothing is known of the targets' places.
double share_beyond_places(const Layout& layout, const LastStep& step, int p);

}  // namespace binrig
