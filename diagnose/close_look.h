// What signatures know of a few periods, places and steps, simulated at those between.
#pragma once

#include <optional>
#include <vector>

#include "diagnose/refine.h"

namespace binrig {

/// Where a hypothesis has a period and a phase, or a place in the image, its best ones: what the signatures say of them
/// is of a few periods or a coarse grid only. Simulated are the three captures in which its signatures change most, and
/// of periods the third that gains most there in six, since in fewer one wave does what another does. Where it is a
/// step, the best of those it is tried at, by simulation: what a step does to the lines of the values is no small
/// change. Else, and where nothing is better, the start. `reach`: of by_place. `least`: of chi, what a period has to
/// gain to be worth finding; if none does, were all captures like the three, the start. Throws what
/// simulating throws.
LinearGain look_close_by(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start,
                         const std::vector<Signature>& signatures, std::optional<double> reach = {}, double least = 0);

}  // namespace binrig
