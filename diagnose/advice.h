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

/// Targets of the train captures (without series and motion) are put nearer, further away and tilted, and simulated
/// with all models, each with its effect as it fits the recording. Those that would tell the first from every one of
/// the others (their distance is beyond what chance makes of it, with the same margin as between effects that are not
/// confounded), furthest first. Base and lens count as known: they are, from the captures at hand. Throws what
/// simulating throws.
std::vector<AdvisedCapture> captures_that_separate(const Experiment& experiment,
                                                   const std::vector<SceneMotion>& motions, const Rung& rung,
                                                   const SensorModel& one, const std::vector<SensorModel>& others,
                                                   std::uint64_t seed);

}  // namespace binrig
