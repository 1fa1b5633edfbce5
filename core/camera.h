// The pinhole camera with OpenCV's distortion.
//
// The centre of the top-left pixel is (0, 0): a camera whose optical axis meets the middle of a w x h image has
// cx = (w - 1) / 2. Depth is Z along the optical axis, in mm.
#pragma once

#include <array>
#include <string>

#include <Eigen/Core>

namespace binrig {

struct Camera {
  int width = 0, height = 0;            ///< px
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< px
  /// OpenCV's rational model: k1 k2 p1 p2 k3 k4 k5 k6; all zero = none.
  std::array<double, 8> distortion{};

  bool operator==(const Camera&) const = default;
  bool distorted() const;

  /// Throws Error naming `where` and every bad number: non-positive size or focal length, anything not finite,
  /// more than 16384 px a side.
  void check(const std::string& where) const;

  /// Pixel (px) of a point in the camera frame (mm). Undefined for z <= 0.
  Eigen::Vector2d project(const Eigen::Vector3d& p_C) const;

  /// The viewing ray (x/z, y/z, 1) through pixel (u, v): distortion removed by fixed-point iteration followed by
  /// Newton steps, to 1e-10 in normalised coordinates where the distortion is invertible.
  Eigen::Vector3d ray(double u, double v) const;

  /// The same view at another resolution: pixel edges, not centres, keep their place.
  Camera resized(int new_width, int new_height) const;
};

/// Camera from a horizontal field of view (rad) with square pixels and the axis through the image centre.
Camera camera_from_field_of_view(int width, int height, double horizontal_fov_rad);

/// Normalised image coordinates of EFFECTS.md: x and y from the principal point divided by half the width,
/// r2 = (x^2 + y^2) / (1 + (h/w)^2), so that r2 = 1 in the corners of a centred camera.
struct ImageCoordinates {
  explicit ImageCoordinates(const Camera& camera);
  double x(double u) const { return (u - cx) * scale; }
  double y(double v) const { return (v - cy) * scale; }
  double r2(double u, double v) const { return (x(u) * x(u) + y(v) * y(v)) * corner; }
  double cx, cy, scale, corner;
};

}  // namespace binrig
