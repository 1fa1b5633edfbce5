// A parameter's values tried one by one, where no slope leads: periods, steps, edges that move pixel after pixel. How
// far chi has to rise before a value is ruled out is measured on the model's own simulations. (Chi-square's 3.84 holds
// where chi is a parabola; here every value draws its simulations anew, and chi is as rough as that.)
#pragma once

#include <map>
#include <vector>

#include "diagnose/rung.h"

namespace binrig {

class Profile {
 public:
  /// `motions`: targets go along to where a value wants them; empty = they stay at `place`. `metric`: of the motions,
  /// on train. What is given must outlive the profile.
  Profile(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung, const Metric& metric,
          const std::vector<double>& place, bool targets_go_along, std::uint64_t seed);

  /// Simulates the model with this value and returns chi; one that was asked before is not simulated again. The first
  /// value asked is the one at which the rung's own simulations were made. Throws what simulating throws.
  double ask(double value, const SensorModel& model);

  double best() const;
  /// By how much chi may rise above its least for a value to hold: 95 % of the rung's own simulations do not rise
  /// further at the value they were made with, and never less than chi-square's 3.84 times the rung's dispersion.
  double limit() const;
  bool holds(double value) const { return tried_.at(value).chi <= tried_.at(best()).chi + limit(); }
  /// From the nearest value below all that hold to the nearest above: between the two the bound is anywhere. `lower`
  /// and `upper` where no value tried is ruled out on that side.
  std::pair<double, double> interval(double lower, double upper) const;
  bool open_below() const { return holds(tried_.begin()->first); }
  bool open_above() const { return holds(tried_.rbegin()->first); }

 private:
  struct Tried {
    double chi;
    std::vector<double> nulls;  ///< chi of the rung's simulations, each taken for the recording
  };
  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const Metric& metric_;
  const std::vector<double> place_;
  const bool targets_go_along_;
  const std::uint64_t seed_;
  std::vector<Metric> fold_metrics_;
  std::map<double, Tried> tried_;
  double at_nulls_ = 0;
};

}  // namespace binrig
