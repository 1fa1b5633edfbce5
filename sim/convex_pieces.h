// Non-convex parts collide as what they are: a few convex pieces instead of one hull.
#pragma once

#include <vector>

#include "core/pose.h"

namespace binrig {

/// The convex hull of `points`, grown by `radius_mm`: one point and a radius are a ball.
struct ConvexPiece {
  std::vector<Vector3> points;  ///< mm, frame O of the part
  double radius_mm = 0;
};

}  // namespace binrig
