// What was needed on the way up may be superfluous beside what was added later.
#pragma once

#include "diagnose/climb.h"

namespace binrig {

/// Leaves each added effect out of the last rung's model once more; the last, which just proved itself, only if its
/// strength may be nothing (may_be_nothing, by its last step): then what else was fitted with it may have made the
/// model better. It goes where the held-out score is no larger without it (if its strength may be nothing, by its fit,
/// or is less than a quarter of what it was when it was added: no more than 0.02 above the score with it, or above the
/// floor of 1), all others as they are and the proper score hardly worse (0.0025), or all others fitted again (what has
/// faded: and the proper score hardly worse); the last, too, if nothing more is unexplained then and the others
/// bring nine tenths of what it brought: a rung without it, a warning that says so. True if the last one went: nobody
/// looked yet for what is missing without it. Throws what simulating throws.
bool take_out_superfluous(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                          const Measurement& measured, Climbed& climbed);

}  // namespace binrig
