// A second look from the parameters as they were given. What is missing may have bent the model's own parameters so far
// that under the fitted model nothing helps; under the given ones the missing effect may stand out.
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

/// Where a second look begins: not where the model was bent to.
struct Beginning {
  SensorModel model;
  std::vector<Signature> signatures;    ///< about the model, or about it without what was added since it was given
  std::vector<StatVector> simulations;  ///< of the model, short: SignatureBook::simulations
};

/// The `most` hypotheses whose signatures, simulated with targets at their nominal places, bring the beginning's model
/// nearest to the measurement on train (poses, lens and the model's own parameters free in the linear view; periods
/// and steps looked at closely, with the targets at nominal), each fitted. A step that leaves more than nine tenths of
/// what is left without it is none: no slope leads from it to the right one. Those that draw a map of the unit are
/// none: their signatures are of another one. None if the nearest is `known`, which the fitted model names, too (-1:
/// nothing it names was accepted). `least_share`: of chi, by hypothesis; those that before they are fitted explain less
/// than that are none, either. Empty = all are worth it. Throws what simulating throws.
std::vector<Anew> look_anew(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                            const Measurement& measured, const Beginning& from, const Hypotheses& hypotheses, int known,
                            int most, std::uint64_t seed, const std::vector<double>& least_share = {});

}  // namespace binrig
