// Fits end where two simulations cut short say that they are good; a model is not there yet.
#pragma once

#include "diagnose/rung.h"

namespace binrig {

/// Steps against all of the model's own simulations, two or, while they gain much, a few more, until they are short;
/// half as far where a whole one makes it worse on train, by the proper score (diagnose/score.h). Short is less than
/// six standard deviations of the step's own direction (LastStep::length), or less than lowers that score by a
/// thousandth, an element. Each makes the rung anew, without fits. `options`: with which it was fitted. Throws what
/// simulating throws.
void settle_down(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                 const RungOptions& options, Rung& rung);

}  // namespace binrig
