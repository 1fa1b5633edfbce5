// Calibration: any parameters of the effects that a model has, fitted jointly with poses and lens to a recording set by
// simulating it again and again, with intervals, and with the names of those that the recording cannot determine.
// Nothing is known of a parameter but its declaration.
//
// The fit is the diagnosis's own (diagnose/rung.h). At its end the model is simulated `simulations` times as if each
// simulation were a recording, with its own draws and poses. The recording is compared with their mean for a last
// Newton step, and the scatter of the very same step over them is the covariance: weights that are not the optimal ones
// (practical floors, correlations that the whitening misses) cost precision, but not the intervals' honesty.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "diagnose/hypotheses.h"
#include "diagnose/rung.h"

namespace binrig {

struct CalibrationOptions {
  std::vector<std::string> fixed;  ///< id or id.parameter: stays as it is
  std::vector<std::string> only;   ///< the same: nothing else is fitted; empty = all
  int simulations = 32;            ///< of the fitted model, for the last step and the intervals
  int passes = 2, iterations = 8;  ///< of RungOptions
  SeenSteps seen;                  ///< tried as values of the model's steps; StepReader, beside the model without_steps
  std::uint64_t seed = 1;
  std::string provenance;  ///< which recording, written beside the values
};

struct CalibratedParameter {
  std::string id, name, unit;
  double before = 0, value = 0;
  std::optional<std::array<double, 2>> ci95;  ///< absent where not determined
  bool determined() const { return ci95.has_value(); }
  std::string reason;    ///< why it is not determined, "" where it is
  double narrowing = 1;  ///< standard deviation after over that before (the prior's), on the scale of the fit
};

struct Calibration {
  /// With values, intervals and provenance. What is not determined has no interval and stays where its prior, the value
  /// given, holds it; but a mask's strength that is tried far and near may have gone where nothing moves with it.
  SensorModel model;
  std::vector<CalibratedParameter> parameters;  ///< in the model's order, without those that stay
  Rung rung;                                    ///< of the model before the last step: for scores
  double dispersion = 1;  ///< mean square of the residual over that of the model's own simulations, at least 1
  bool converged = false;
};

/// Whether `fixed` and `only` leave a parameter to be fitted.
bool is_fitted(const CalibrationOptions& options, const std::string& id, const std::string& parameter);

/// Only train captures are fitted to. `measured` of Experiment::measure. Throws Error if a name of `fixed` or `only` is
/// in no effect of the model, or nothing is left to fit.
Calibration calibrate(const Experiment& experiment, const Measurement& measured, const SensorModel& start,
                      const CalibrationOptions& options);

}  // namespace binrig
