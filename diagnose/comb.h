// Steps (of a quantisation) meet the data in valleys narrower than anything that a fit tries.
#pragma once

#include "diagnose/hypotheses.h"
#include "diagnose/rung.h"

namespace binrig {

/// A step that was `seen` in the recorded values near that of the rung's model (within a factor of 1.5) takes its place
/// if with it, all else fitted, the recording is likelier. Where the model still leaves something on train unexplained
/// (a wrong step need not show in all statistics together: noise is bent to make up for it, and then the spectrum is not
/// right), all values close to where its steps are and to where they began, in `start`, are tried one by one, and the
/// other parameters fitted to the best. `options`: with which the rung was fitted; steps that it fixes stay. Throws what
/// simulating throws.
void comb_steps(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                const SensorModel& start, const SeenSteps& seen, const RungOptions& options, Rung& rung);

}  // namespace binrig
