// Parts as Bullet has them. Lengths are mm there, too.
#pragma once

#include <memory>
#include <vector>

#include <btBulletDynamicsCommon.h>

#include "sim/stacking.h"

namespace binrig {

/// Pieces are shrunk by the margin that Bullet adds again around them, so that they touch where the part's faces do.
inline constexpr double contact_margin_mm = 0.05;

btVector3 to_bullet(const Vector3& v);
btTransform to_bullet(const Pose& X);
Pose to_pose(const btTransform& transform);

/// Bullet stops what comes together fast at the first touch, a step ahead of it, and the little speed that is left
/// after that is what bounces. Here the contacts that would close within this step count as closed, so that the whole
/// speed bounces.
class BouncingWorld : public btDiscreteDynamicsWorld {
 public:
  using btDiscreteDynamicsWorld::btDiscreteDynamicsWorld;

 protected:
  void solveConstraints(btContactSolverInfo& info) override;
};

/// A kind of part ready for Bullet: M is the frame of its principal axes about its centre of mass.
struct BulletKind {
  std::vector<std::unique_ptr<btCollisionShape>> pieces;
  std::unique_ptr<btCompoundShape> shape;
  Pose X_OM = Pose::Identity();
  btVector3 inertia;
  double radius_mm = 0;
};

/// The body must have been checked: its pieces enclose a volume, and its inertia is positive.
BulletKind make_kind(const Body& body);

}  // namespace binrig
