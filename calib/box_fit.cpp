#include "calib/box_fit.h"

#include <algorithm>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace binrig {
namespace {

// Two directions in the plane that complete its normal to a right-handed frame.
Eigen::Matrix3d frame_of(const Vector3& normal) {
  Eigen::Matrix3d axes;
  axes.col(2) = normal;
  axes.col(0) = normal.unitOrthogonal();
  axes.col(1) = normal.cross(axes.col(0));
  return axes;
}

float quantile(std::vector<float> values, double share) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

BoxFit fit_box(const cv::Mat& depth_mm, const PixelRays& rays, const cv::Mat& mask, const PlaneFit& plane) {
  const Eigen::Matrix3d axes = frame_of(plane.normal);
  std::vector<Vector3> points;  // in the plane's axes, z = height above it
  for (int row = 0; row < depth_mm.rows; ++row) {
    for (int col = 0; col < depth_mm.cols; ++col) {
      const double z = depth_mm.at<float>(row, col);
      if (z <= 0 || mask.at<std::uint8_t>(row, col) == 0) continue;
      const Vector3 p_C(rays.x.at<double>(row, col) * z, rays.y.at<double>(row, col) * z, z);
      points.push_back(axes.transpose() * p_C - Vector3(0, 0, plane.offset_mm));
    }
  }
  if (points.size() < 50) throw Error(fmt::format("a box needs 50 measured points, here are {}", points.size()));

  std::vector<cv::Point2f> footprint;
  std::vector<float> heights;
  for (const Vector3& p : points) {
    footprint.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
    heights.push_back(static_cast<float>(p.z()));
  }
  // The direction from the rectangle of least area, the extent from quantiles along it: single flying pixels must not
  // widen the box.
  const cv::RotatedRect rectangle = cv::minAreaRect(footprint);
  const double angle = rectangle.angle * CV_PI / 180;
  const Eigen::Vector2d along(std::cos(angle), std::sin(angle)), across(-std::sin(angle), std::cos(angle));
  std::vector<float> s, t;
  for (const cv::Point2f& p : footprint) {
    s.push_back(static_cast<float>(along.x() * p.x + along.y() * p.y));
    t.push_back(static_cast<float>(across.x() * p.x + across.y() * p.y));
  }
  const double s0 = quantile(s, 0.01), s1 = quantile(s, 0.99), t0 = quantile(t, 0.01), t1 = quantile(t, 0.99);
  const double height = std::max(1.0f, quantile(heights, 0.99));

  BoxFit fit;
  fit.pixels = static_cast<int>(points.size());
  fit.size_mm = Vector3(s1 - s0, t1 - t0, height);
  const Eigen::Vector2d centre = along * (0.5 * (s0 + s1)) + across * (0.5 * (t0 + t1));
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.block<2, 1>(0, 0) = along;
  turn.block<2, 1>(0, 1) = across;
  fit.X_CO.linear() = axes * turn;
  fit.X_CO.translation() = axes * Vector3(centre.x(), centre.y(), plane.offset_mm + 0.5 * height);

  double squares = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double side = std::min({std::abs(s[i] - s0), std::abs(s1 - s[i]), std::abs(t[i] - t0), std::abs(t1 - t[i])});
    const double distance = std::min(side, std::abs(height - heights[i]));
    squares += distance * distance;
  }
  fit.rms_mm = std::sqrt(squares / static_cast<double>(points.size()));
  return fit;
}

std::vector<std::array<Vector3, 4>> plane_patch(const Camera& camera, const cv::Mat& mask, const PlaneFit& plane, int cell_px) {
  std::vector<std::array<Vector3, 4>> cells;
  const cv::Rect image(0, 0, mask.cols, mask.rows);
  for (int row = 0; row < mask.rows; row += cell_px) {
    for (int col = 0; col < mask.cols; col += cell_px) {
      const cv::Rect cell = cv::Rect(col, row, cell_px, cell_px) & image;
      if (2 * cv::countNonZero(mask(cell)) < cell.area()) continue;
      // Pixel edges, so that neighbouring cells meet and a pixel's centre lies inside its cell.
      const double u0 = col - 0.5, v0 = row - 0.5, u1 = u0 + cell.width, v1 = v0 + cell.height;
      std::array<Vector3, 4> corners;
      bool met = true;
      int i = 0;
      for (auto [u, v] : {std::pair{u0, v0}, {u1, v0}, {u1, v1}, {u0, v1}}) {
        const Vector3 ray = camera.ray(u, v);
        const double z = plane.depth_mm(ray.x(), ray.y());
        met &= z > 0;
        corners[i++] = ray * z;
      }
      if (met) cells.push_back(corners);
    }
  }
  return cells;
}

}  // namespace binrig
