#include "report/cloud.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace binrig {

namespace {

constexpr std::size_t most_points = 40000;

void check(const CloudFigure& figure) {
  Violations violations;
  if (figure.panels.empty()) violations.add("cloud " + figure.name, "", "has no panel");
  if (!(figure.low < figure.high)) violations.add("cloud " + figure.name, "low", "must lie below high");
  for (const CloudPanel& panel : figure.panels) {
    if (panel.points.size() != panel.values.size()) {
      violations.add("cloud " + figure.name, panel.title, "needs one value a point");
    }
    for (const auto& p : panel.points) {
      if (p.allFinite()) continue;
      violations.add("cloud " + figure.name, panel.title, "has a coordinate that is not finite");
      break;
    }
  }
  violations.throw_if_any("a point cloud cannot be drawn");
}

}  // namespace

std::vector<PackedCloud> pack(const CloudFigure& figure) {
  check(figure);
  Eigen::Vector3f low = Eigen::Vector3f::Constant(std::numeric_limits<float>::max()), high = -low;
  for (const CloudPanel& panel : figure.panels) {
    for (const auto& p : panel.points) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  }
  const Eigen::Vector3f centre = 0.5f * (low + high);
  const float half = std::max(1e-6f, 0.5f * (high - low).maxCoeff());
  std::vector<PackedCloud> packed;
  for (const CloudPanel& panel : figure.panels) {
    PackedCloud cloud;
    const std::size_t step = std::max<std::size_t>(1, (panel.points.size() + most_points - 1) / most_points);
    for (std::size_t i = 0; i < panel.points.size(); i += step) {
      for (int k = 0; k < 3; ++k) {
        cloud.xyz.push_back(static_cast<std::int16_t>(std::lround((panel.points[i][k] - centre[k]) / half * 32000)));
      }
      const double place = (panel.values[i] - figure.low) / (figure.high - figure.low) * (scale_steps - 1);
      cloud.colour.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(place, 0.0, scale_steps - 1.0))));
    }
    packed.push_back(std::move(cloud));
  }
  return packed;
}

cv::Mat compose(const CloudFigure& figure) {
  constexpr int width = 520, height = 420;
  const auto packed = pack(figure);
  const auto& table = scale_colours(figure.colours);
  cv::Mat sheet(height + 28, width * static_cast<int>(packed.size()), CV_8UC3, cv::Scalar(255, 255, 255));
  const double cy = std::cos(figure.yaw_rad), sy = std::sin(figure.yaw_rad);
  const double cp = std::cos(figure.pitch_rad), sp = std::sin(figure.pitch_rad);
  for (std::size_t i = 0; i < packed.size(); ++i) {
    cv::Mat panel = sheet(cv::Rect(width * static_cast<int>(i), 28, width, height));
    cv::Mat nearest(height, width, CV_32F, cv::Scalar(1e9));
    // Points large enough to close the gaps between them where the cloud is a sheet.
    const int size =
        std::clamp(static_cast<int>(std::lround(0.95 * width / std::sqrt(packed[i].colour.size() + 1.0))), 2, 9);
    for (std::size_t k = 0; k < packed[i].colour.size(); ++k) {
      const double x = packed[i].xyz[3 * k] / 32000.0, y = packed[i].xyz[3 * k + 1] / 32000.0,
                   z = packed[i].xyz[3 * k + 2] / 32000.0;
      const double x1 = cy * x + sy * z, z1 = cy * z - sy * x;
      const double y2 = cp * y - sp * z1, z2 = sp * y + cp * z1;
      const double scale = 0.46 * width / (1 + 0.22 * z2);
      const int u = static_cast<int>(width / 2 + scale * x1), v = static_cast<int>(height / 2 + scale * y2);
      for (int dv = 0; dv < size; ++dv) {
        for (int du = 0; du < size; ++du) {
          if (u + du < 0 || v + dv < 0 || u + du >= width || v + dv >= height) continue;
          float& depth = nearest.at<float>(v + dv, u + du);
          if (z2 >= depth) continue;
          depth = static_cast<float>(z2);
          const Rgb colour = table[packed[i].colour[k]];
          panel.at<cv::Vec3b>(v + dv, u + du) = {colour[0], colour[1], colour[2]};
        }
      }
    }
    cv::putText(sheet, figure.panels[i].title, {width * static_cast<int>(i) + 12, 19}, cv::FONT_HERSHEY_SIMPLEX, 0.45,
                {40, 44, 52}, 1, cv::LINE_AA);
  }
  return sheet;
}

}  // namespace binrig
