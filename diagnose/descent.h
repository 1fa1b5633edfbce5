// Where a fit stands, and how it goes down from there: damped Gauss-Newton steps on derivatives by simulation.
#pragma once

#include <vector>

#include "diagnose/slope_simulation.h"

namespace binrig {

constexpr double least_gain = 1;  ///< of chi, for which a value is taken

/// Walks the parameters of one fit. What is given to the constructor must outlive it, but for `start` and `offsets`.
/// Whatever simulates throws what simulating throws.
class Descent {
 public:
  Descent(const Descent&) = delete;  // its slopes refer to it
  Descent& operator=(const Descent&) = delete;
  /// Stands at `start` with the targets at `offsets`.
  Descent(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
          std::vector<FitParameter> parameters, const SensorModel& start, const std::vector<Offset>& offsets,
          const FitOptions& options);

  const FitState& now() const { return now_; }
  const std::vector<FitParameter>& parameters() const { return parameters_; }

  /// What other values of the fitted parameters leave of the data, with targets that went along from where they stand.
  FitState evaluate(const Eigen::VectorXd& value) const;
  /// The same of one that is not fitted; `value` is in its own unit.
  FitState evaluate(const std::string& id, const std::string& name, double value) const;
  /// The same after steps of those that are fitted, with their slopes as last simulated, as long as they help: what had
  /// been bent to make up for the wrong value goes along with the right one. Not far off, where others bent it.
  FitState evaluate_and_follow(const std::string& id, const std::string& name, double value) const;
  void move_to(FitState state) { now_ = std::move(state); }
  /// Fits these, too, from what the model has.
  void also_fit(const std::vector<FitParameter>& more);
  Eigen::VectorXd within_bounds(Eigen::VectorXd value) const;
  /// Share of the captures in which a parameter changed anything; 1 where that was not asked.
  double touched_share(int parameter) const { return slopes_.touched_share(parameter); }

  /// Goes down until chi falls by less than FitOptions::converged.
  void run();
  /// What was found; the walk is over.
  Fit result() &&;

 private:
  FitState evaluate(const SensorModel& model, const Eigen::VectorXd& value) const;
  Eigen::VectorXd values_of_model() const;
  Explained explain(FitState& state) const;
  bool moved(const Explained& explained, FitState& state) const;
  void linearise(const FitState& state, Eigen::MatrixXd& a, Eigen::VectorXd& b) const;
  void look_at_information(const Eigen::MatrixXd& a);
  void box(const Eigen::VectorXd& value, Eigen::VectorXd& lower, Eigen::VectorXd& upper) const;
  bool widen(const Eigen::VectorXd& delta);
  Eigen::Array<bool, Eigen::Dynamic, 1> acting_widely() const;
  double stretch(const Eigen::VectorXd& from);

  const Experiment& experiment_;
  const Standard& standard_;
  const Metric& metric_;
  const Whitened& data_;
  const FitOptions& options_;
  std::vector<FitParameter> parameters_;
  int n_;  // parameters
  FitState now_;
  Fit fit_;  // slopes, precision and what was paused
  SlopeSimulation slopes_;
};

}  // namespace binrig
