// A plane fitted to a depth image, and the flat region it was fitted to.
//
// Frame: C, the camera (x right, y down, z forward), mm. A plane is n . p = d with the unit normal n turned towards the
// camera, so that d < 0. Residuals are along Z (measured depth minus the plane's depth on the same ray), because that
// is the direction in which depth noise acts and in which sim/ adds it; multiply by the cosine of incidence and the
// ray's length over z for the orthogonal distance.
#pragma once

#include <cmath>
#include <cstdint>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "core/camera.h"
#include "core/frame.h"
#include "core/pose.h"

namespace binrig {

/// x/z and y/z of every pixel's viewing ray, lens distortion removed. CV_64F, height x width. Cheap to make again for
/// the cameras used last (core/ray_table.h).
struct PixelRays {
  explicit PixelRays(const Camera& camera);
  Camera camera;
  cv::Mat x, y;
};

struct PlaneFitOptions {
  /// The noise's standard deviation is taken to grow with this power of depth; 2 is the law of triangulation.
  double sigma_exponent = 2;
  int min_pixels = 400;              ///< fewer valid pixels in the region are an error
  double max_incidence_rad = 1.396;  ///< 80 deg; a plane seen at a more grazing angle is an error
  std::uint64_t seed = 1;            ///< of RANSAC's draws
};

struct PlaneFit {
  Vector3 normal = Vector3(0, 0, -1);
  double offset_mm = 0;     ///< d
  cv::Mat region;           ///< CV_8U, 255 where the surface is flat: the given mask, or the region found
  cv::Mat valid;            ///< CV_8U, 255 in the region where depth was measured and is no gross outlier (8 sigma)
  cv::Mat residual_mm;      ///< CV_32F, along Z, measured minus plane; 0 outside `valid`
  int pixels = 0;           ///< of `valid`
  double inlier_share = 0;  ///< of the region's measured pixels: within 4 robust sigmas of the plane
  double fill_share = 0;    ///< measured pixels / region
  double rms_z_mm = 0;      ///< root mean square of residual_mm over `valid`
  double rms_orthogonal_mm = 0;
  double sigma_mm = 0;       ///< robust (1.4826 MAD) at the region's mean depth, along Z
  double distance_mm = 0;    ///< mean depth of the plane over the region
  double incidence_rad = 0;  ///< angle between the ray through the region's centre and the normal
  /// Covariance of (a, b, c) in 1/z = a x/z + b y/z + c (1/mm), counting correlated pixels: inflated by the ratio of
  /// the variance of 16 x 16 block means to that of independent pixels.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();

  /// Depth of the plane on a ray, mm; 0 where the ray never meets it in front of the camera.
  double depth_mm(double ray_x, double ray_y) const {
    const double z = offset_mm / (normal.x() * ray_x + normal.y() * ray_y + normal.z());
    return z > 0 && std::isfinite(z) ? z : 0;
  }
  /// CV_32F depth image of the plane alone (0 where not met).
  cv::Mat perfect_depth(const PixelRays& rays) const;
};

/// Fits a plane: RANSAC on the region's pixels, then weighted least squares on inverse depth (in which a plane is
/// linear and noise ~ z^2 has equal variance) with Tukey weights until it stands still. depth_mm: CV_32F, mm, 0 =
/// invalid, size of the camera. mask: CV_8U, non-zero = flat target, or empty: then the largest connected flat region
/// of the image is found, and kept 3 px away from its border. Throws Error: NaN or negative depth (pixel named), wrong
/// size, fewer than min_pixels, no plane (less than half of a given region on one plane; no flat region), a plane
/// beyond max_incidence_rad.
PlaneFit fit_plane(const cv::Mat& depth_mm, const PixelRays& rays, const cv::Mat& mask = {},
                   const PlaneFitOptions& options = {});

/// The largest flat region: CV_8U, 255 inside, as fit_plane finds it. Throws Error as fit_plane.
cv::Mat find_flat_region(const cv::Mat& depth_mm, const PixelRays& rays, const PlaneFitOptions& options = {});

}  // namespace binrig
