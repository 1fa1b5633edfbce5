// Does a pile lie as a real one would? Measured from poses and pieces alone, apart from the engine that made it.
#pragma once

#include <vector>

#include "sim/stacking.h"

namespace binrig {

struct PileQuality {
  double most_penetration_mm = 0;  ///< of any two pieces of different parts, or of a piece and the bin
  /// Largest hover: for each part the least gap (mm) to anything that could bear it, that is, whose surface pushes it
  /// upwards at the nearest points; over all parts the largest.
  double most_hover_mm = 0;
  int hovering = 0;  ///< parts with more than 0.5 mm
  /// Pairs of parts more than 0.05 mm inside each other that no small motion (15 mm, 0.3 rad) can set free.
  int interlocked = 0;
};

/// Up is where gravity does not pull: (0, 0, 1) in B turned by -tilt about x.
PileQuality pile_quality(const std::vector<Body>& bodies, const BinBox& bin, const std::vector<PlacedPart>& parts,
                         double tilt_rad = 0);
PileQuality pile_quality(const Stacking& stacking);

}  // namespace binrig
