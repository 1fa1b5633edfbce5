// The figures of merit that depth cameras' makers state, on a plane (after Intel, "Intel RealSense Depth Module:
// testing methodology", 2018). Exact formulas, with e = z - z_plane after removing each frame's own best plane, over
// the pixels of the region that were measured (holes are left out, not counted as 0; no outlier is removed):
//   fill rate        measured pixels / pixels of the region, mean over frames
//   Z-accuracy       median over pixels of z - z_plane before the frame's own plane is removed, mean over frames. Only
//                    where the plane is known independently of this depth
//   plane-fit RMS    sqrt(mean over pixels and frames of (e |n . r|)^2), r = (x/z, y/z, 1): the orthogonal distance
//   sub-pixel RMS    sqrt(mean of D^2), D = f B / z - f B / z_plane in px of disparity. Only where f B is known
//   temporal noise   median over pixels (measured in >= 2 frames) of the standard deviation over frames (n - 1)
// Lengths are also stated in per cent of the plane's mean distance.
#pragma once

#include <optional>

#include "compare/noise/pixel_maps.h"
#include "compare/noise/plane_residual.h"

namespace binrig {

struct PlaneMetrics {
  double distance_mm = 0;
  double fill_rate = 0;
  std::optional<double> z_accuracy_mm;
  double plane_rms_mm = 0;
  std::optional<double> subpixel_rms_px;
  std::optional<double> temporal_noise_mm;
  double percent_of_distance(double length_mm) const { return distance_mm > 0 ? 100 * length_mm / distance_mm : 0; }
};

class PlaneMetricsSum {
 public:
  PlaneMetricsSum(const PlaneCapture& capture, const PlaneResidual& plane);
  void add(const Frame& frame, const ResidualFrame& residual);
  PlaneMetrics finish(const PixelMaps& maps) const;

 private:
  bool independent_;
  double focal_baseline_, distance_;
  int region_pixels_, frames_ = 0;
  cv::Mat plane_mm_, lean_;  // lean: |n . r|
  double fill_ = 0, accuracy_ = 0, square_ = 0, disparity_square_ = 0, pixels_ = 0;
};

}  // namespace binrig
