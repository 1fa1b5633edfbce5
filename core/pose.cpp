#include "core/pose.h"

#include <Eigen/SVD>

#include "core/error.h"

namespace binrig {

Pose pose_from_rows(const double* rotation_rows9, const double* translation_mm3) {
  const Eigen::Matrix3d given = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation_rows9);
  const Vector3 translation = Eigen::Map<const Vector3>(translation_mm3);
  if (!given.allFinite() || !translation.allFinite()) throw Error("a pose holds a number that is not finite");
  if ((given * given.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > 1e-3) {
    throw Error("a rotation matrix is not orthonormal (further than 1e-3)");
  }
  if (given.determinant() < 0) throw Error("a rotation matrix is left-handed");
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(given, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Pose pose = Pose::Identity();
  pose.linear() = svd.matrixU() * svd.matrixV().transpose();
  pose.translation() = translation;
  return pose;
}

Pose small_motion(const Vector6& motion, const Vector3& centre_mm) {
  const Vector3 rotation = motion.head<3>();
  const double angle = rotation.norm();
  Pose turn = Pose::Identity();
  if (angle > 0) turn.linear() = Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix();
  turn.translation() = centre_mm - turn.linear() * centre_mm + motion.tail<3>();
  return turn;
}

double rotation_between_rad(const Pose& a, const Pose& b) {
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

double distance_between_mm(const Pose& a, const Pose& b) { return (a.translation() - b.translation()).norm(); }

}  // namespace binrig
