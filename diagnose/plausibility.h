// Whether a recording and a model can be about the same instrument at all, and whether the recording can answer.
#pragma once

#include <string>
#include <vector>

#include "diagnose/experiment.h"

namespace binrig {

/// Throws Error where they cannot be: depths in another unit, poses of another scene, shadows on the other side of the
/// objects. No effect is to be named then. `data`: statistics of all measured frames.
void check_registration(const Experiment& experiment, const StatVector& data, const SensorModel& model);

/// What the recording lacks for any answer, in words; empty = nothing.
std::vector<std::string> lacking_data(const Experiment& experiment, const StatVector& data);

}  // namespace binrig
