// Rigid poses.
//
// X_AB is the pose of frame B in frame A: p_A = X_AB * p_B, and adjacent letters cancel, X_AC = X_AB * X_BC.
// W = world, C = camera (OpenCV: x right, y down, z forward), O = object (the frame of its mesh), P = projector.
// Translations are millimetres.
#pragma once

#include <Eigen/Geometry>

namespace binrig {

using Pose = Eigen::Isometry3d;
using Vector3 = Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// Pose from a row-wise 3x3 rotation and a translation in mm. The rotation is projected onto SO(3) (text files carry
/// seven digits); throws Error if it is further than 1e-3 from orthonormal, or left-handed, or not finite.
Pose pose_from_rows(const double* rotation_rows9, const double* translation_mm3);

/// A small motion: rotation vector (rad, elements 0..2) about `centre_mm`, then a translation (mm, elements 3..5).
Pose small_motion(const Vector6& motion, const Vector3& centre_mm = Vector3::Zero());

/// Angle (rad) of the rotation that takes a to b, and distance (mm) of their origins.
double rotation_between_rad(const Pose& a, const Pose& b);
double distance_between_mm(const Pose& a, const Pose& b);

}  // namespace binrig
