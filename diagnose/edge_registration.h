// Targets are registered by their surfaces (diagnose/registration.h). Where depth edges cross pixels, a shift too small
// for these to show puts whole columns of pixels on the other side.
#pragma once

#include "diagnose/rung.h"

namespace binrig {

/// In captures that stand out from the rung's model (captures_that_stand_out, diagnose/score.h), tries the target a
/// little to either side, motion by motion and by simulation, about where the rung has it; what targets are registered
/// to (registered_to) is the length of a step. Where that explains these captures, the rung is made anew
/// with the targets there, if its proper score (diagnose/score.h) over all captures falls; once or twice more with those
/// of which a twentieth less is left, as long as that is worth it. Nuisances alone are fitted, so that captures held out have a say in theirs.
/// `options`: with which the rung was fitted. True if the rung is another one. Throws what simulating throws.
bool register_by_edges(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                       const Measurement& measured, const RungOptions& options, Rung& rung);

}  // namespace binrig
