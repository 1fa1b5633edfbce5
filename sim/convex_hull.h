// Convex hulls of point clouds.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>

#include "core/pose.h"

namespace binrig {

/// A half-space: inside where normal . p <= offset (mm). The normal is a unit vector that points outwards.
struct HalfSpace {
  Vector3 normal = Vector3::UnitZ();
  double offset_mm = 0;
  double outside_mm(const Vector3& p) const { return normal.dot(p) - offset_mm; }
};

struct ConvexHull {
  std::vector<Vector3> vertices;              ///< mm; a subset of the points given
  std::vector<std::array<int, 3>> triangles;  ///< counter-clockwise seen from outside
  std::vector<HalfSpace> faces;               ///< one per planar face
  double volume_mm3 = 0;

  /// How far p lies outside (> 0) or how deep inside (< 0); outside it is a lower bound of the distance.
  double outside_mm(const Vector3& p) const;
};

/// Points that span no volume (all in a plane, fewer than four) give a hull without triangles and with volume 0.
/// Points within a ten-thousandth of the extent of the hull's surface may be left out.
ConvexHull convex_hull(const std::vector<Vector3>& points);

/// A hull with fewer vertices that lies inside the given one and reaches every one of its vertices to within
/// `tolerance_mm`: curved surfaces of fine meshes carry hundreds of points that a collision does not need.
ConvexHull simplified_hull(const ConvexHull& hull, double tolerance_mm);

}  // namespace binrig
