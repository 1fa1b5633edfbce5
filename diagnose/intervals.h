// The end of a calibration: which values of the fitted parameters the recording allows, and of which it says nothing.
#pragma once

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "diagnose/calibration.h"
#include "diagnose/last_step.h"

namespace binrig {

/// A fit whose last step is taken.
struct LastFit {
  const Experiment& experiment;
  const std::vector<SceneMotion>& motions;
  const Rung& rung;  ///< of the model before that step
  const LastStep& last;
  const std::vector<FitParameter>& first;  ///< priors stand where the user began
  bool poses_known = false;                ///< where targets stand is stated
  std::uint64_t seed = 1;
};

/// Gives `parameters` (all of `fit.first` and of `steps` must be there, without intervals) their values, and intervals
/// or the reason why they have none; `model`, that of the last step, goes where values move. `steps`: instance and
/// parameter of what is tried value by value where slopes know no interval. Throws what simulating throws.
void find_intervals(const LastFit& fit, const std::vector<std::pair<std::string, const ParameterSpec*>>& steps,
                    SensorModel& model, std::vector<CalibratedParameter>& parameters);

/// Intervals of the instances `of`, of `fit.first`: those of the last step, grown to what simulations rule out, as far
/// as slopes say too little: thresholds and widths that move pixel after pixel, strengths that another parameter makes
/// up for, and masks, which may be anything typical where nothing of that is ruled out. Their whole numbers and steps,
/// too, unless the model has an interval for them or nothing of them is ruled out. `model`, that of the last step, goes
/// where simulations want it. Throws what simulating throws.
std::vector<CalibratedParameter> widened_intervals(const LastFit& fit, const std::set<std::string>& of,
                                                   SensorModel& model);

}  // namespace binrig
