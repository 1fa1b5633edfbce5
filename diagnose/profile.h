// A parameter's values tried one by one, where no slope leads: periods, steps, edges that move pixel after pixel. How
// far chi has to rise before a value is ruled out is measured on the model's own simulations. (Chi-square's 3.84 holds
// where chi is a parabola; here every value draws its simulations anew, and chi is as rough as that.) Source: Feldman
// and Cousins, Unified approach to the classical statistical analysis of small signals, Phys. Rev. D 57, 3873 (1998);
// they have a limit for each value, we have one for all, that of the value the rung was simulated with.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "diagnose/rung.h"

namespace binrig {

class Profile {
 public:
  /// `metric`: of the `motions`, on train. `place`: of these, in prior sigmas, in the rung's simulations;
  /// `targets_go_along`: from there to where each value wants them. `seed`: of the simulations of all values. What is
  /// given must outlive the profile, but for `place`.
  Profile(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung, const Metric& metric,
          const std::vector<double>& place, bool targets_go_along, std::uint64_t seed);

  /// Simulates `model`, which has this value (natural unit), and returns its chi (Fit::chi); one that was asked before
  /// is not simulated again. The first value asked stands for the one at which the rung's own simulations were made;
  /// one beside that makes the limit wider.
  /// Throws what simulating throws.
  double ask(double value, const SensorModel& model);

  /// The value tried whose chi is least. This and all below: something must have been asked.
  double best() const;
  /// By how much chi may rise above its least for a value to hold: 95 % of the rung's own simulations do not rise
  /// further at the value they were made with, and never less than chi-square's 3.84 times the rung's dispersion.
  double limit() const;
  /// Not ruled out. `value` must have been asked (std::out_of_range).
  bool holds(double value) const { return tried_.at(value).chi <= tried_.at(best()).chi + limit(); }
  /// From the nearest value below all that hold to the nearest above: between the two the bound is anywhere. `lower`
  /// and `upper` where no value tried is ruled out on that side.
  std::pair<double, double> interval(double lower, double upper) const;
  /// The smallest, the largest value tried is not ruled out.
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

/// What else of a model goes along where one of its parameters was given another value.
using Follow = std::function<SensorModel(const SensorModel&)>;

/// Tries values of the parameter `spec` of instance `id`, from the model's, about the best one so far, `reaches` times
/// `unit` away (in the parameter's own unit; on its logarithm where it is declared so), until none is better, and then
/// further out until both sides are ruled out. Where nothing typical is ruled out on either side, that is the answer.
/// Without `follow`, nothing else changes. Throws what it throws, and what simulating throws.
void explore(Profile& profile, const SensorModel& model, const std::string& id, const ParameterSpec& spec, double unit,
             const std::vector<double>& reaches, const Follow& follow = {});
/// The same for a parameter between whose values nothing moves smoothly: whole numbers by ones, others by factors.
void explore_steps(Profile& profile, const SensorModel& model, const std::string& id, const ParameterSpec& spec,
                   const Follow& follow = {});
/// Where the parameter lies for certain, in its own unit: Profile::interval between its bounds, but whole numbers that
/// are ruled out are not included; none if neither side is ruled out. Something must have been asked.
std::optional<std::array<double, 2>> certain(const Profile& profile, const ParameterSpec& spec);

}  // namespace binrig
