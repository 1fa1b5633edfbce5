#include "compare/noise/plane_residual.h"

#include <cmath>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/ray_table.h"

namespace binrig {

cv::Mat plane_depth(const Camera& camera, const PlaneTarget& target) {
  cv::Mat depth(camera.height, camera.width, CV_32F, cv::Scalar(0));
  const cv::Mat rays = exact_ray_table(camera);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const auto& ray = rays.at<cv::Vec2d>(v, u);
      const double along = target.normal.x() * ray[0] + target.normal.y() * ray[1] + target.normal.z();
      const double z = std::abs(along) > 1e-9 ? target.offset_mm / along : 0;
      if (z > 0 && z < 1e6) depth.at<float>(v, u) = static_cast<float>(z);
    }
  }
  return depth;
}

PlaneResidual::PlaneResidual(const Camera& camera, const PlaneTarget& target) {
  if (target.region.size() != cv::Size(camera.width, camera.height) || target.region.type() != CV_8U) {
    throw Error(fmt::format("the plane's region must be a CV_8U image of {} x {} px, not {} x {}", camera.width,
                            camera.height, target.region.cols, target.region.rows));
  }
  plane_mm_ = plane_depth(camera, target);
  region_ = (target.region != 0) & (plane_mm_ > 0);
  region_ /= 255;
  region_pixels_ = cv::countNonZero(region_);
  if (region_pixels_ < smallest_region) {
    throw Error(fmt::format("the plane's region has {} px: statistics of noise need at least {}", region_pixels_,
                            smallest_region));
  }
  box_ = cv::boundingRect(region_);
  mean_distance_mm_ = cv::mean(plane_mm_, region_)[0];
}

ResidualFrame PlaneResidual::operator()(const Frame& frame) const {
  if (frame.depth_mm.size() != plane_mm_.size()) {
    throw Error(fmt::format("a frame of {} x {} px does not fit a plane of {} x {} px", frame.depth_mm.cols,
                            frame.depth_mm.rows, plane_mm_.cols, plane_mm_.rows));
  }
  ResidualFrame out;
  out.residual_mm = cv::Mat(plane_mm_.size(), CV_32F, cv::Scalar(0));
  out.valid = cv::Mat(plane_mm_.size(), CV_8U, cv::Scalar(0));
  for (int v = box_.y; v < box_.br().y; ++v) {
    for (int u = box_.x; u < box_.br().x; ++u) {
      const float z = frame.depth_mm.at<float>(v, u);
      if (!region_.at<std::uint8_t>(v, u) || z <= 0) continue;
      out.residual_mm.at<float>(v, u) = z - plane_mm_.at<float>(v, u);
      out.valid.at<std::uint8_t>(v, u) = 1;
      ++out.pixels;
    }
  }
  if (out.pixels < 3) return out;
  const double cx = box_.x + 0.5 * (box_.width - 1), cy = box_.y + 0.5 * (box_.height - 1);
  const double sx = 2.0 / std::max(1, box_.width - 1), sy = 2.0 / std::max(1, box_.height - 1);
  Eigen::Vector3d motion = Eigen::Vector3d::Zero();
  double limit = 1e30;
  const auto basis = [&](int u, int v) {
    const double z = plane_mm_.at<float>(v, u) / mean_distance_mm_;
    return Eigen::Vector3d(z * z, z * z * (u - cx) * sx, z * z * (v - cy) * sy);
  };
  for (int pass = 0; pass < 2; ++pass) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    double square = 0;
    int used = 0;
    for (int v = box_.y; v < box_.br().y; ++v) {
      for (int u = box_.x; u < box_.br().x; ++u) {
        if (!out.valid.at<std::uint8_t>(v, u)) continue;
        const Eigen::Vector3d g = basis(u, v);
        const double e = out.residual_mm.at<float>(v, u);
        if (std::abs(e - motion.dot(g)) > limit) continue;
        normal.noalias() += g * g.transpose();
        right += e * g;
        square += e * e;
        ++used;
      }
    }
    if (used < 3) break;
    motion = normal.ldlt().solve(right);
    limit = 5 * std::sqrt(std::max(0.0, square - motion.dot(right)) / used);
  }
  out.offset_mm = motion[0];
  out.tilt_x_mm = motion[1];
  out.tilt_y_mm = motion[2];
  for (int v = box_.y; v < box_.br().y; ++v) {
    for (int u = box_.x; u < box_.br().x; ++u) {
      if (out.valid.at<std::uint8_t>(v, u))
        out.residual_mm.at<float>(v, u) -= static_cast<float>(motion.dot(basis(u, v)));
    }
  }
  return out;
}

}  // namespace binrig
