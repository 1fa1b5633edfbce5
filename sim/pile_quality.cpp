#include "sim/pile_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include <BulletCollision/NarrowPhaseCollision/btGjkEpaPenetrationDepthSolver.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkPairDetector.h>
#include <BulletCollision/NarrowPhaseCollision/btPointCollector.h>
#include <LinearMath/btConvexHullComputer.h>
#include <btBulletCollisionCommon.h>

namespace binrig {
namespace {

// Two parts further apart than this do not matter to each other.
constexpr double reach_mm = 30;
constexpr double hovering_mm = 0.5, locked_from_mm = 0.05;
// Upward share of a normal from which a surface can bear: a steep flank does, a wall does not.
constexpr double bearing_cosine = 0.05;
// Bounds of the motions tried to set a pair free.
constexpr int release_rounds = 200;
constexpr double release_mm = 15, release_rad = 0.3;

/// A solid with its place: pieces as shapes whose margin is part of them.
struct Solid {
  std::vector<std::unique_ptr<btConvexShape>> shapes;
  std::vector<Pose> X_OS;  ///< of the shapes
  Vector3 centre_mm = Vector3::Zero();
  double radius_mm = 0;
};

// Hulls are shrunk by a margin that is added again around them: the search for the nearest points is exact and sure
// while the shrunk ones are apart. Corners come out rounder by (sqrt(3) - 1) of it, 0.04 mm.
constexpr double hull_margin_mm = 0.05;

btTransform to_bullet(const Pose& X) {
  const Eigen::Quaterniond q(X.linear());
  const Vector3& t = X.translation();
  return btTransform(btQuaternion(btScalar(q.x()), btScalar(q.y()), btScalar(q.z()), btScalar(q.w())),
                     btVector3(btScalar(t.x()), btScalar(t.y()), btScalar(t.z())));
}

Solid solid_of(const Body& body) {
  Solid solid;
  solid.centre_mm = body.mass.centre_mm;
  solid.radius_mm = bounding_radius_mm(body);
  for (const ConvexPiece& piece : body.pieces) {
    Pose X = Pose::Identity();
    if (piece.points.size() == 1) {
      X.translation() = piece.points[0];
      solid.shapes.push_back(std::make_unique<btSphereShape>(btScalar(piece.radius_mm)));
    } else {
      // Around its own centre: single precision has digits to spare then.
      Vector3 centre = Vector3::Zero();
      for (const Vector3& p : piece.points) centre += p / static_cast<double>(piece.points.size());
      X.translation() = centre;
      std::vector<Vector3> points;
      for (const Vector3& p : piece.points) points.push_back(p - centre);
      btConvexHullComputer shrunk;
      shrunk.compute(points.front().data(), static_cast<int>(sizeof(Vector3)), static_cast<int>(points.size()),
                     btScalar(std::max(0.0, hull_margin_mm - piece.radius_mm)), btScalar(0.5));
      auto hull = std::make_unique<btConvexHullShape>();
      for (int i = 0; i < shrunk.vertices.size(); ++i) hull->addPoint(shrunk.vertices[i], false);
      hull->recalcLocalAabb();
      hull->setMargin(btScalar(std::max(hull_margin_mm, piece.radius_mm)));
      solid.shapes.push_back(std::move(hull));
    }
    solid.X_OS.push_back(X);
  }
  return solid;
}

/// The bin as the slabs that the physics has.
std::vector<std::pair<Vector3, Vector3>> bin_slabs(const BinBox& bin) {  // half sizes, centres
  const double w = bin.inner_size_mm.x(), l = bin.inner_size_mm.y(), h = bin.inner_size_mm.z(), t = bin.wall_mm;
  std::vector<std::pair<Vector3, Vector3>> slabs{{Vector3(w / 2 + t, l / 2 + t, t / 2), Vector3(0, 0, -t / 2)}};
  if (h > 0) {
    for (double side : {-1.0, 1.0}) {
      slabs.emplace_back(Vector3(t / 2, l / 2 + t, h / 2), Vector3(side * (w + t) / 2, 0, h / 2));
      slabs.emplace_back(Vector3(w / 2, t / 2, h / 2), Vector3(0, side * (l + t) / 2, h / 2));
    }
  }
  return slabs;
}

struct Contact {
  double gap_mm = 0;  ///< < 0: depth
  Vector3 normal;     ///< on a, pointing away from b
  Vector3 point_mm;   ///< on b
};

std::optional<Contact> nearest(const btConvexShape& a, const Pose& X_a, const btConvexShape& b, const Pose& X_b) {
  // Near the origin, where single precision is finest.
  const Vector3 origin = X_a.translation();
  Pose A = X_a, B = X_b;
  A.translation() -= origin;
  B.translation() -= origin;
  btVoronoiSimplexSolver simplex;
  btGjkEpaPenetrationDepthSolver depth;
  btGjkPairDetector detector(&a, &b, &simplex, &depth);
  btDiscreteCollisionDetectorInterface::ClosestPointInput input;
  input.m_transformA = to_bullet(A);
  input.m_transformB = to_bullet(B);
  input.m_maximumDistanceSquared = btScalar(reach_mm * reach_mm);
  btPointCollector found;
  detector.getClosestPoints(input, found, nullptr);
  if (!found.m_hasResult) return std::nullopt;
  const btVector3 &n = found.m_normalOnBInWorld, &p = found.m_pointInWorld;
  return Contact{double(found.m_distance), Vector3(n.x(), n.y(), n.z()), Vector3(p.x(), p.y(), p.z()) + origin};
}

std::vector<Contact> contacts(const Solid& a, const Pose& X_a, const Solid& b, const Pose& X_b) {
  std::vector<Contact> all;
  for (std::size_t i = 0; i < a.shapes.size(); ++i) {
    for (std::size_t k = 0; k < b.shapes.size(); ++k) {
      if (const auto c = nearest(*a.shapes[i], X_a * a.X_OS[i], *b.shapes[k], X_b * b.X_OS[k])) all.push_back(*c);
    }
  }
  return all;
}

bool near(const Solid& a, const Pose& X_a, const Solid& b, const Pose& X_b, double reach) {
  return (X_a * a.centre_mm - X_b * b.centre_mm).norm() < a.radius_mm + b.radius_mm + reach;
}

/// Pushes a out of b along the normals where they touch, round after round, as a hand would that wriggles it.
bool can_be_freed(const Solid& a, Pose X_a, const Solid& b, const Pose& X_b) {
  const Pose start = X_a;
  constexpr double clear_mm = 0.05;
  for (int round = 0; round < release_rounds; ++round) {
    double deepest = std::numeric_limits<double>::infinity();
    for (const Contact& c : contacts(a, X_a, b, X_b)) {
      deepest = std::min(deepest, c.gap_mm);
      if (c.gap_mm >= clear_mm) continue;
      // The least motion that opens this contact by what it lacks; a turn of one radian counts as the part's radius.
      const Vector3 centre = X_a * a.centre_mm, lever = (c.point_mm - centre).cross(c.normal) / a.radius_mm;
      const double push = 0.5 * (clear_mm + 0.01 - c.gap_mm) / (1 + lever.squaredNorm());
      Vector6 motion;
      motion << lever * push / a.radius_mm, c.normal * push;
      X_a = small_motion(motion, centre) * X_a;
    }
    if (deepest >= 0) return true;
    if (distance_between_mm(start, X_a) > release_mm || rotation_between_rad(start, X_a) > release_rad) return false;
  }
  return false;
}

}  // namespace

PileQuality pile_quality(const std::vector<Body>& bodies, const BinBox& bin, const std::vector<PlacedPart>& parts,
                         double tilt_rad) {
  PileQuality quality;
  std::vector<Solid> solids;
  for (const Body& body : bodies) solids.push_back(solid_of(body));
  std::vector<std::unique_ptr<btBoxShape>> slabs;
  std::vector<Pose> X_BS;
  for (const auto& [half, centre] : bin_slabs(bin)) {
    slabs.push_back(
        std::make_unique<btBoxShape>(btVector3(btScalar(half.x()), btScalar(half.y()), btScalar(half.z()))));
    slabs.back()->setMargin(btScalar(hull_margin_mm));
    X_BS.push_back(Pose(Eigen::Translation3d(centre)));
  }
  const Vector3 up = Eigen::AngleAxisd(-tilt_rad, Vector3::UnitX()) * Vector3::UnitZ();
  // With nothing in reach a part hovers at least that far.
  std::vector<double> hover(parts.size(), reach_mm);
  const auto bear = [&](std::size_t i, const Contact& c, double sign) {
    if (sign * c.normal.dot(up) > bearing_cosine) hover[i] = std::min(hover[i], std::max(0.0, c.gap_mm));
  };
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Solid& a = solids[static_cast<std::size_t>(parts[i].kind)];
    for (std::size_t s = 0; s < slabs.size(); ++s) {
      for (std::size_t k = 0; k < a.shapes.size(); ++k) {
        const auto c = nearest(*a.shapes[k], parts[i].X_BO * a.X_OS[k], *slabs[s], X_BS[s]);
        if (!c) continue;
        quality.most_penetration_mm = std::max(quality.most_penetration_mm, -c->gap_mm);
        bear(i, *c, 1);
      }
    }
    for (std::size_t j = i + 1; j < parts.size(); ++j) {
      const Solid& b = solids[static_cast<std::size_t>(parts[j].kind)];
      if (!near(a, parts[i].X_BO, b, parts[j].X_BO, 2)) continue;
      double deepest = 0;
      for (const Contact& c : contacts(a, parts[i].X_BO, b, parts[j].X_BO)) {
        deepest = std::max(deepest, -c.gap_mm);
        bear(i, c, 1);
        bear(j, c, -1);
      }
      quality.most_penetration_mm = std::max(quality.most_penetration_mm, deepest);
      if (deepest > locked_from_mm && !can_be_freed(a, parts[i].X_BO, b, parts[j].X_BO)) ++quality.interlocked;
    }
  }
  for (double gap : hover) {
    quality.most_hover_mm = std::max(quality.most_hover_mm, gap);
    quality.hovering += gap > hovering_mm;
  }
  return quality;
}

PileQuality pile_quality(const Stacking& stacking) {
  return pile_quality(stacking.bodies(), stacking.bin(), stacking.parts(), stacking.tilt_rad());
}

}  // namespace binrig
