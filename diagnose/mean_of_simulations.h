// What a model makes of the experiment on the average, for comparing it with one unit's recording.
#pragma once

#include <string>
#include <vector>

#include "diagnose/experiment.h"
#include "diagnose/standard.h"

namespace binrig {

/// Simulations of a unit whose fixed depth map is 0: what other units have there is as likely to be its negative, and a
/// mean over a few units would compare their maps with that of the one measured. Only the bias maps differ from those
/// of Experiment::simulate, and only for models with effects that draw such a map. `as_they_are`, if given: the
/// latter's. Throws what simulating throws.
std::vector<StatVector> simulate_typical_units(const Experiment& experiment, const std::vector<Trial>& trials,
                                               const std::string& progress,
                                               std::vector<StatVector>* as_they_are = nullptr);

/// Mean of whitened (not compressed) simulations, and how far each is from it, scaled to the mean's own error (empty
/// with one simulation). What some do not know is filled from the others.
struct MeanOfSimulations {
  Whitened mean;
  std::vector<Whitened> noise;
};
MeanOfSimulations mean_of(const Standard& standard, std::vector<StatVector> simulations);

}  // namespace binrig
