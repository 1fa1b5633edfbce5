#include "core/camera.h"

#include <cmath>

#include <Eigen/LU>

#include "core/error.h"

namespace binrig {
namespace {

// OpenCV's rational model on normalised coordinates.
Eigen::Vector2d distort(const std::array<double, 8>& k, const Eigen::Vector2d& p) {
  const double x = p.x(), y = p.y(), r2 = x * x + y * y;
  const double radial =
      (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
  return {x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
          y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y};
}

}  // namespace

bool Camera::distorted() const {
  for (double k : distortion) {
    if (k != 0) return true;
  }
  return false;
}

void Camera::check(const std::string& where) const {
  Violations violations;
  auto size = [&](const char* key, int value) {
    if (value < 1 || value > 16384) violations.add({where, key, std::to_string(value), "px", "1 .. 16384", ""});
  };
  size("width", width);
  size("height", height);
  auto focal = [&](const char* key, double value) {
    if (!std::isfinite(value) || value <= 0) {
      violations.add({where, key, number_text(value), "px", "", "must be a positive number"});
    }
  };
  focal("fx", fx);
  focal("fy", fy);
  auto finite = [&](const std::string& key, double value) {
    if (!std::isfinite(value)) violations.add({where, key, number_text(value), "", "", "must be a number"});
  };
  finite("cx", cx);
  finite("cy", cy);
  for (std::size_t i = 0; i < distortion.size(); ++i) finite("distortion[" + std::to_string(i) + "]", distortion[i]);
  violations.throw_if_any("the camera is not usable");
}

Eigen::Vector2d Camera::project(const Eigen::Vector3d& p_C) const {
  Eigen::Vector2d p(p_C.x() / p_C.z(), p_C.y() / p_C.z());
  if (distorted()) p = distort(distortion, p);
  return {fx * p.x() + cx, fy * p.y() + cy};
}

Eigen::Vector3d Camera::ray(double u, double v) const {
  const Eigen::Vector2d target((u - cx) / fx, (v - cy) / fy);
  Eigen::Vector2d p = target;
  if (distorted()) {
    for (int i = 0; i < 5; ++i) p += target - distort(distortion, p);
    for (int i = 0; i < 6; ++i) {
      const Eigen::Vector2d miss = target - distort(distortion, p);
      if (miss.cwiseAbs().maxCoeff() < 1e-12) break;
      constexpr double h = 1e-6;
      Eigen::Matrix2d jacobian;
      for (int a = 0; a < 2; ++a) {
        Eigen::Vector2d step = Eigen::Vector2d::Zero();
        step[a] = h;
        jacobian.col(a) = (distort(distortion, p + step) - distort(distortion, p - step)) / (2 * h);
      }
      p += jacobian.partialPivLu().solve(miss);
    }
  }
  return {p.x(), p.y(), 1.0};
}

Camera Camera::resized(int new_width, int new_height) const {
  Camera camera = *this;
  const double sx = static_cast<double>(new_width) / width, sy = static_cast<double>(new_height) / height;
  camera.width = new_width;
  camera.height = new_height;
  camera.fx = fx * sx;
  camera.fy = fy * sy;
  camera.cx = (cx + 0.5) * sx - 0.5;
  camera.cy = (cy + 0.5) * sy - 0.5;
  return camera;
}

Camera camera_from_field_of_view(int width, int height, double horizontal_fov_rad) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 0.5 * width / std::tan(0.5 * horizontal_fov_rad);
  camera.cx = 0.5 * (width - 1);
  camera.cy = 0.5 * (height - 1);
  camera.check("camera");
  return camera;
}

ImageCoordinates::ImageCoordinates(const Camera& camera) : cx(camera.cx), cy(camera.cy), scale(2.0 / camera.width) {
  const double aspect = static_cast<double>(camera.height) / camera.width;
  corner = 1 / (1 + aspect * aspect);
}

}  // namespace binrig
