// Per-pixel sums over frames, and what follows from them: fixed pattern against temporal noise.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "compare/noise/plane_residual.h"

namespace binrig {

/// The split of EMVA Standard 1288 (release 4.0, section on nonuniformity), on depth residuals. With s_t^2 = mean over
/// pixels of the variance over time, and the mean image over T frames:
///   spatial^2 = variance of the mean image - s_t^2 / T
///   column^2 + pixel^2 / rows = variance of its column means, corrected for their own variance over time; rows
///   likewise spatial^2 = row^2 + column^2 + pixel^2
/// We deviate: the temporal part of row and column means is measured (variance over time of each row's mean), not
/// derived from s_t^2, because the noise of neighbouring pixels is correlated; and invalid pixels are left out
/// everywhere. Components that come out negative are stated as 0.
struct NoiseSplit {
  bool done = false;  ///< false with a single frame
  double temporal_mm = 0;
  double spatial_mm = 0, row_mm = 0, column_mm = 0, pixel_mm = 0;  ///< fixed pattern and its parts
  double temporal_row_mm = 0, temporal_column_mm = 0;  ///< standard deviation over time of row and column means
};

class PixelMaps {
 public:
  PixelMaps(const cv::Size& size, const cv::Mat& region);
  void add(const ResidualFrame& frame);
  int frames() const { return frames_; }
  /// CV_32F: mean over the frames that measured the pixel, 0 where fewer than half did (at least one; two of several).
  cv::Mat mean_mm() const;
  /// CV_8U 0/1 where mean_mm says something.
  cv::Mat known() const;
  /// CV_32F: standard deviation over time (n - 1), 0 where fewer than two frames measured the pixel.
  cv::Mat temporal_sigma_mm() const;
  /// CV_32F: share of frames that measured the pixel; 0 outside the region.
  cv::Mat fill() const;
  /// CV_32F: frames that measured the pixel.
  const cv::Mat& count() const { return count_; }
  NoiseSplit split() const;

 private:
  cv::Mat region_, count_, sum_, square_;  // CV_32F, CV_64F
  int frames_ = 0;
  // Row and column means over time.
  std::vector<double> row_n_, row_sum_, row_square_, col_n_, col_sum_, col_square_;
};

}  // namespace binrig
