// Derivatives of the statistics by simulation, for a fit: one parameter a step ahead (or to both sides), with common
// random numbers.
#pragma once

#include <optional>
#include <vector>

#include "diagnose/fit.h"

namespace binrig {

/// A model, where the targets want to be with it, and what that leaves of the data.
struct FitState {
  SensorModel model;
  Eigen::VectorXd value;  ///< of the fitted parameters, on the scale of the fit
  std::vector<Offset> offsets;
  std::vector<double> place;
  std::vector<StatVector> simulations;  ///< one a seed
  std::vector<Whitened> noise;          ///< of their mean, see MeanOfSimulations
  Whitened residual;
  double chi = 0;         ///< Fit::chi
  double dispersion = 1;  ///< chi by known statistic, at least 1
};

/// Simulation `seed` of those by which a fit sees a model.
inline Trial trial_of(const FitOptions& options, const SensorModel& model, const std::vector<Offset>& offsets,
                      int seed) {
  return {model,
          offsets,
          options.seed + static_cast<std::uint64_t>(seed),
          options.part,
          options.most_frames,
          options.shorten_series};
}

/// Slopes of a fit that goes on: what is given to the constructor is the fit's own and changes under way.
class SlopeSimulation {
 public:
  /// `parameters`: steps that are too short grow. `now`: where slopes are taken. `fit`: slopes and seed_slopes of
  /// parameters that are not paused are written.
  SlopeSimulation(const Experiment& experiment, const Standard& standard, const FitOptions& options,
                  std::vector<FitParameter>& parameters, const FitState& now, Fit& fit)
      : experiment_(experiment),
        standard_(standard),
        options_(options),
        parameters_(parameters),
        now_(now),
        fit_(fit) {}

  /// Takes them; what drowns in its own noise is taken again over the longest step. Throws what simulating throws.
  void run();
  /// Share of the captures in which a parameter changed anything; 1 where that was not asked.
  double touched_share(int parameter) const;

 private:
  /// Captures in which a parameter changed anything when it was asked at `value`.
  struct Touched {
    double value = 0;
    std::vector<int> captures;
  };

  void run_of(const std::vector<int>& moved);
  double derivative_step(int parameter) const;
  std::vector<std::vector<StatVector>> simulate_ahead(const std::vector<int>& moved);
  std::vector<std::vector<StatVector>> simulate_behind(const std::vector<int>& moved) const;

  const Experiment& experiment_;
  const Standard& standard_;
  const FitOptions& options_;
  std::vector<FitParameter>& parameters_;
  const FitState& now_;
  Fit& fit_;
  std::vector<std::optional<Touched>> touched_;  // by parameter
};

}  // namespace binrig
