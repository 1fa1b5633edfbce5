// Which single effect, added to a model, moves its statistics onto the measured ones, on captures it was not fitted to.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "diagnose/anew.h"
#include "diagnose/search_result.h"

namespace binrig {

/// How a rung's model came about, and what was tried on the way.
struct Standing {
  bool added;  ///< effects were added to the model given
  bool bent;   ///< a parameter of the model given went far from there, in the rung as it is now
  /// The last second look from the parameters as given named nothing that was added.
  bool looked_in_vain;
  /// A step of which all values are whole multiples goes first; false where that was tried and made nothing better.
  bool exact_steps_first;
  /// Waves are looked for at all periods; false where as much is left as when that was done last.
  bool closely = true;
  /// Effects whose map of the unit, fitted, did not look random where as much was left: it is not fitted again.
  std::set<std::string> no_maps;
};

/// Gains are of chi (whitened, dimensionless), those of refined hypotheses with the rung's dispersion divided out.
/// `motions`: of scene_motions for this experiment; targets are put where each hypothesis wants them. `signatures`: of
/// `hypotheses`, by their indices. `beginning`: the model with the parameters that it was given, for fits from there,
/// asked for if it is needed; with what was added to it since. Throws what simulating throws.
SearchResult search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                    const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
                    const Standing& standing, const std::function<Beginning()>& beginning,
                    const SearchOptions& options);

}  // namespace binrig
