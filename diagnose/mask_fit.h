// What clears pixels in a few captures has a strength and an edge that make up for each other: beside the valley of the
// right pair lie others, out of which neither a slope nor one parameter alone leads.
#pragma once

#include <optional>
#include <string>

#include "diagnose/rung.h"

namespace binrig {

/// Where captures stand out from the rung's model (captures_that_stand_out, diagnose/score.h), fits the parameters of
/// each effect that acts in them, and in no more than half of all captures, again on train: from where the user put
/// them, by the proper score of the captures in which it acts and no longer by the distance in units of one model's
/// randomness; downhill simplex (Nelder and Mead, The Computer Journal 1965). The rung is made anew with what was found
/// if its proper score on train falls. `given`: the user's model; `options`: with which the rung was fitted. True if
/// the rung is another one. Throws what simulating throws.
bool fit_masks(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
               const SensorModel& given, const RungOptions& options, Rung& rung);

/// Rare drop-outs that only captures held out show: those fitted to say little of a mask that hardly ever clears
/// anything there, and the fit takes it away from where it would. The id of an effect of the model that, somewhere
/// between where the fit left it and where the user put it, explains all captures within the model's own randomness;
/// none if no such does. Nothing is fitted to anything. Throws what simulating throws.
std::optional<std::string> mask_that_may_stand_elsewhere(const Experiment& experiment,
                                                         const std::vector<SceneMotion>& motions,
                                                         const Measurement& measured, const SensorModel& given,
                                                         const RungOptions& options, const Rung& rung);

}  // namespace binrig
