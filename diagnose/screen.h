// What the unexplained remainder goes with: covariates of the scene and places in the image, fitted on train, scored on
// captures held out.
#pragma once

#include "diagnose/diagnose.h"

namespace binrig {

/// True if a step across a line or a curve over a covariate explains most of what a pattern fixed in the image would of
/// the bias on captures held out: then that is no map of a unit.
bool has_simple_shape(const Experiment& experiment, const Rung& rung, const StatVector& data);

/// True if bias on captures held out goes with its place in the image, or with a covariate, as it does on train, beyond
/// what chance makes of it, in a normal distribution and in the model's own simulations (which have maps of units of
/// their own). All of its squares together may still be what the model's randomness makes them.
bool bias_goes_with_something(const Experiment& experiment, const Rung& rung, const StatVector& data);

/// Fills covariates, share, shape and, for depth, a formula effect to paste, of entries that are maps (bias, noise,
/// drop-out).
void screen(const Experiment& experiment, const Rung& rung, const StatVector& data, std::vector<Unexplained>& entries);

}  // namespace binrig
