// What was needed on the way up may be superfluous beside what was added later.
#pragma once

#include "diagnose/climb.h"

namespace binrig {

/// Leaves each added effect out of the last rung's model once more; the last, which just proved itself, only if it may
/// be nothing (diagnose/fit.h): then what else was fitted with it made the model better. It goes where the held-out
/// score is no larger without it, all others as they are and the proper score hardly worse (0.0025), or all others
/// fitted again: a rung without it, a warning that says so. Throws what simulating throws.
void take_out_superfluous(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                          const Measurement& measured, Climbed& climbed);

}  // namespace binrig
