// What to capture next: where two effects that look the same in a recording would differ.
#pragma once

#include <string>
#include <vector>

#include "diagnose/rung.h"

namespace binrig {

/// A capture like one that was recorded, its target somewhere else.
struct AdvisedCapture {
  int capture = 0;       ///< the one it is like
  Offset where;          ///< of its target, from where that one's nominally stood
  std::string where_to;  ///< both in words: "train/2 plane_800 130 mm further away"
  /// Square of what tells the models apart there, of chi; poses within their prior count nothing. Of several, of the
  /// one nearest to the first.
  double distance2 = 0;
};

/// One of the effects that look the same: a model with it, as it fits the recording.
struct LookAlike {
  const SensorModel& model;
  const std::string& id;  ///< of the effect's instance
  const Fit& fit;         ///< its parameters are among these; none that are not can make it look like the others
};

/// Targets of the train captures (without series and motion) are put nearer, further away and tilted, and simulated
/// with all models. Those that would tell the first from every one of the others whichever is there (their distance is
/// beyond what chance makes of it, with the same margin as between effects that are not confounded), furthest first.
/// Either model's parameters and the lens are fitted to what the other one's capture would be, as far as those at hand
/// leave them free (Gauss-Newton with the precision that the recording gives them, on the scale of `rung`). Throws what
/// simulating throws.
std::vector<AdvisedCapture> captures_that_separate(const Experiment& experiment,
                                                   const std::vector<SceneMotion>& motions, const Rung& rung,
                                                   const LookAlike& one, const std::vector<LookAlike>& others,
                                                   std::uint64_t seed);

}  // namespace binrig
