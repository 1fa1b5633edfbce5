// A second look from the model as it was given. What is missing may have bent the model's own parameters so far that
// under the fitted model nothing helps; under the given one the missing effect may stand out.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "diagnose/signatures.h"

namespace binrig {

/// A model with one effect added, all its parameters fitted anew from where they were given.
struct Anew {
  int hypothesis = 0;
  std::string id;  ///< of the added instance
  Fit fit;
};

/// The `most` hypotheses whose signatures, simulated about `given` with targets at their nominal places, come nearest
/// to the measurement on train (poses, lens and the given model's parameters free in the linear view; periods looked at
/// closely, with the targets at nominal), each fitted. Those that draw a map of the unit are none: their signatures are
/// of another one. None if the nearest is `known`, which the fitted model names, too (-1: nothing it names was
/// accepted). `simulations`: of `given`, short; `signatures`: about it.
/// Throws what simulating throws.
std::vector<Anew> look_anew(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                            const Measurement& measured, const SensorModel& given, const Hypotheses& hypotheses,
                            const std::vector<Signature>& signatures, const std::vector<StatVector>& simulations,
                            int known, int most, std::uint64_t seed);

}  // namespace binrig
