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
  std::string where_to;  ///< the same in words
  double distance2 =
      0;  ///< square of what tells the two models apart there, of chi; poses within their prior count nothing
};

/// Targets of the train captures (without series and motion) are put nearer, further away and tilted, and simulated
/// with both models, each with its effect as it fits the recording. Those that would tell the models apart (their
/// distance is beyond what chance makes of it, with the same margin as between effects that are not confounded),
/// furthest first. Base and lens count as known: they are, from the captures at hand. Throws what simulating throws.
std::vector<AdvisedCapture> captures_that_separate(const Experiment& experiment,
                                                   const std::vector<SceneMotion>& motions, const Rung& rung,
                                                   const SensorModel& one, const SensorModel& other,
                                                   std::uint64_t seed);

}  // namespace binrig
