// How a pixel's noise goes on from frame to frame.
#pragma once

#include <deque>
#include <vector>

#include "compare/noise/autocovariance.h"
#include "compare/noise/plane_residual.h"
#include "compare/probability.h"

namespace binrig {

struct TemporalSummary {
  int frames = 0;
  /// Half the mean square difference of frames 1, 2, ... apart (mm^2): the variance of the noise as far as it is
  /// forgotten in that time.
  std::vector<double> variogram_mm2;
  Estimate lag1_correlation;  ///< 1 - variogram(1) / mean of variogram(2 ..); needs 3 frames
  TestResult frames_independent;
  double repeated_share = 0;  ///< frames identical to their predecessor, of all that have one
  double offset_sigma_mm = 0, tilt_x_sigma_mm = 0, tilt_y_sigma_mm = 0;  ///< scatter of the whole plane's motion
};

/// Frame after frame; keeps the last five.
class TemporalNoise {
 public:
  void add(const ResidualFrame& frame);
  TemporalSummary finish() const;

 private:
  static constexpr int longest_lag = 5, groups = 24;
  std::deque<ResidualFrame> past_;
  std::vector<double> square_ = std::vector<double>(longest_lag * groups, 0), count_ = square_;
  int frames_ = 0, repeated_ = 0;
  double sum_[3] = {0, 0, 0}, sum_square_[3] = {0, 0, 0};
};

}  // namespace binrig
