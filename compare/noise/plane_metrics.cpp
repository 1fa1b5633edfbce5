#include "compare/noise/plane_metrics.h"

#include <algorithm>
#include <cmath>

namespace binrig {

PlaneMetricsSum::PlaneMetricsSum(const PlaneCapture& capture, const PlaneResidual& plane)
    : independent_(capture.target.independent),
      focal_baseline_(capture.focal_baseline_px_mm),
      distance_(plane.mean_distance_mm()),
      region_pixels_(plane.region_pixels()),
      plane_mm_(plane.plane_mm()),
      lean_(plane.plane_mm().size(), CV_32F, cv::Scalar(0)) {
  for (int r = 0; r < lean_.rows; ++r) {
    for (int c = 0; c < lean_.cols; ++c) {
      // n . r = d / z_plane
      const float z = plane_mm_.at<float>(r, c);
      if (z > 0) lean_.at<float>(r, c) = static_cast<float>(std::abs(capture.target.offset_mm) / z);
    }
  }
}

void PlaneMetricsSum::add(const Frame& frame, const ResidualFrame& residual) {
  ++frames_;
  fill_ += static_cast<double>(residual.pixels) / region_pixels_;
  std::vector<float> departures;
  for (int r = 0; r < lean_.rows; ++r) {
    const auto* m = residual.valid.ptr<std::uint8_t>(r);
    for (int c = 0; c < lean_.cols; ++c) {
      if (!m[c]) continue;
      const double e = residual.residual_mm.at<float>(r, c), plane = plane_mm_.at<float>(r, c);
      const double across = e * lean_.at<float>(r, c);
      square_ += across * across;
      pixels_ += 1;
      if (focal_baseline_ > 0 && plane + e > 0) {
        const double d = focal_baseline_ / (plane + e) - focal_baseline_ / plane;
        disparity_square_ += d * d;
      }
      if (independent_) departures.push_back(frame.depth_mm.at<float>(r, c) - static_cast<float>(plane));
    }
  }
  if (departures.empty()) return;
  const auto middle = departures.begin() + static_cast<std::ptrdiff_t>(departures.size() / 2);
  std::nth_element(departures.begin(), middle, departures.end());
  accuracy_ += *middle;
}

PlaneMetrics PlaneMetricsSum::finish(const PixelMaps& maps) const {
  PlaneMetrics out;
  out.distance_mm = distance_;
  if (frames_ == 0 || pixels_ == 0) return out;
  out.fill_rate = fill_ / frames_;
  out.plane_rms_mm = std::sqrt(square_ / pixels_);
  if (independent_) out.z_accuracy_mm = accuracy_ / frames_;
  if (focal_baseline_ > 0) out.subpixel_rms_px = std::sqrt(disparity_square_ / pixels_);
  if (frames_ >= 2) {
    const cv::Mat sigma = maps.temporal_sigma_mm();
    std::vector<float> values;
    for (int r = 0; r < sigma.rows; ++r) {
      for (int c = 0; c < sigma.cols; ++c) {
        if (maps.count().at<float>(r, c) >= 2) values.push_back(sigma.at<float>(r, c));
      }
    }
    if (!values.empty()) {
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      out.temporal_noise_mm = *middle;
    }
  }
  return out;
}

}  // namespace binrig
