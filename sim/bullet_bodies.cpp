#include "sim/bullet_bodies.h"

#include <algorithm>

#include <BulletCollision/CollisionShapes/btMultiSphereShape.h>
#include <LinearMath/btConvexHullComputer.h>
#include <Eigen/Eigenvalues>

namespace binrig {
namespace {

std::unique_ptr<btCollisionShape> piece_shape(const ConvexPiece& piece, const Pose& X_MO) {
  if (piece.points.size() == 1) {
    // Not btSphereShape: Bullet's own pair of spheres has no contact ahead of touch, so that a ball at rest falls for a
    // step now and then and a pile of them never counts as still.
    const btVector3 centre(0, 0, 0);
    const auto radius = btScalar(piece.radius_mm);
    return std::make_unique<btMultiSphereShape>(&centre, &radius, 1);
  }
  std::vector<Vector3> points;
  for (const Vector3& p : piece.points) points.push_back(X_MO * p);
  btConvexHullComputer hull;
  const double shrink = std::max(0.0, contact_margin_mm - piece.radius_mm);
  // At most half of what the thinnest piece has.
  hull.compute(points.front().data(), static_cast<int>(sizeof(Vector3)), static_cast<int>(points.size()),
               btScalar(shrink), btScalar(0.5));
  auto shape = std::make_unique<btConvexHullShape>();
  for (int i = 0; i < hull.vertices.size(); ++i) shape->addPoint(hull.vertices[i], false);
  shape->recalcLocalAabb();
  shape->setMargin(btScalar(std::max(contact_margin_mm, piece.radius_mm)));
  return shape;
}

}  // namespace

btVector3 to_bullet(const Vector3& v) { return btVector3(btScalar(v.x()), btScalar(v.y()), btScalar(v.z())); }

btTransform to_bullet(const Pose& X) {
  const Eigen::Quaterniond q(X.linear());
  return btTransform(btQuaternion(btScalar(q.x()), btScalar(q.y()), btScalar(q.z()), btScalar(q.w())),
                     to_bullet(X.translation()));
}

Pose to_pose(const btTransform& transform) {
  const btQuaternion q = transform.getRotation();
  Pose X = Pose::Identity();
  X.linear() = Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()).normalized().toRotationMatrix();
  const btVector3& t = transform.getOrigin();
  X.translation() = Vector3(t.x(), t.y(), t.z());
  return X;
}

void BouncingWorld::solveConstraints(btContactSolverInfo& info) {
  for (int i = 0; i < getDispatcher()->getNumManifolds(); ++i) {
    btPersistentManifold& manifold = *getDispatcher()->getManifoldByIndexInternal(i);
    const btRigidBody *a = btRigidBody::upcast(manifold.getBody0()), *b = btRigidBody::upcast(manifold.getBody1());
    for (int k = 0; k < manifold.getNumContacts(); ++k) {
      btManifoldPoint& point = manifold.getContactPoint(k);
      if (point.getDistance() <= 0) continue;
      btVector3 v(0, 0, 0);
      if (a) v += a->getVelocityInLocalPoint(point.getPositionWorldOnA() - a->getCenterOfMassPosition());
      if (b) v -= b->getVelocityInLocalPoint(point.getPositionWorldOnB() - b->getCenterOfMassPosition());
      const btScalar closing = -v.dot(point.m_normalWorldOnB);
      if (closing > info.m_restitutionVelocityThreshold && closing * info.m_timeStep > point.getDistance()) {
        point.setDistance(0);
      }
    }
  }
  btDiscreteDynamicsWorld::solveConstraints(info);
}

BulletKind make_kind(const Body& body) {
  BulletKind kind;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(body.mass.inertia_kg_mm2);
  kind.X_OM.linear() = axes.eigenvectors();
  if (kind.X_OM.linear().determinant() < 0) kind.X_OM.linear().col(0) *= -1;
  kind.X_OM.translation() = body.mass.centre_mm;
  kind.inertia = to_bullet(axes.eigenvalues());
  const Pose X_MO = kind.X_OM.inverse();
  kind.shape = std::make_unique<btCompoundShape>(true, static_cast<int>(body.pieces.size()));
  for (const ConvexPiece& piece : body.pieces) {
    btTransform X_MP = btTransform::getIdentity();
    if (piece.points.size() == 1) X_MP.setOrigin(to_bullet(X_MO * piece.points.front()));
    kind.pieces.push_back(piece_shape(piece, X_MO));
    kind.shape->addChildShape(X_MP, kind.pieces.back().get());
  }
  kind.shape->setMargin(btScalar(contact_margin_mm));
  kind.radius_mm = bounding_radius_mm(body);
  return kind;
}

}  // namespace binrig
