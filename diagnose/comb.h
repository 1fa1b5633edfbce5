// Steps (of a quantisation) meet the data in valleys narrower than anything that a fit tries.
#pragma once

#include "diagnose/rung.h"

namespace binrig {

/// Where the rung's model leaves something on train unexplained (a wrong step need not show in all statistics together:
/// noise is bent to make up for it, and then the spectrum is not right), all values close to where its steps are and to
/// where they began, in `start`, are tried one by one, and the other parameters fitted to the best. `options`: with
/// which the rung was fitted; steps that it fixes stay. Throws what simulating throws.
void comb_steps(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                const SensorModel& start, const RungOptions& options, Rung& rung);

}  // namespace binrig
