// Boxes and outlines on a plane: geometry for scenes that were recorded without meshes.
//
// Frames: C = camera, O = the box (its centre), mm.
#pragma once

#include <array>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "calib/plane_fit.h"
#include "core/pose.h"

namespace binrig {

struct BoxFit {
  Pose X_CO = Pose::Identity();           ///< centre of the box; z along the plane's normal, away from the plane
  Vector3 size_mm = Vector3::Zero();      ///< extent along the box's own x, y, z
  double rms_mm = 0;                      ///< of the measured points' distances to the nearest face
  int pixels = 0;
};

/// The upright box that stands on `plane` and encloses the measured points of `mask` (CV_8U): footprint = the rectangle
/// of least area about the points' projections onto the plane without the outermost 1 % on each side, height = the 99 %
/// quantile of their heights. The hidden sides are taken to be vertical. Throws Error for fewer than 50 points.
BoxFit fit_box(const cv::Mat& depth_mm, const PixelRays& rays, const cv::Mat& mask, const PlaneFit& plane);

/// The part of a plane that a mask covers, as quadrilaterals of cell_px x cell_px pixels (mm, camera frame, corners in
/// order): as far as the plane is known to reach. Cells of which the mask covers less than half are left out.
std::vector<std::array<Vector3, 4>> plane_patch(const Camera& camera, const cv::Mat& mask, const PlaneFit& plane, int cell_px = 8);

}  // namespace binrig
