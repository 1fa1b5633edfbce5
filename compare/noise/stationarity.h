// Is the noise equally strong everywhere? If not, what does it go with?
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "compare/probability.h"

namespace binrig {

struct Stationarity {
  TestResult equal_everywhere;  ///< chi-square over cells; the map is each cell's sigma over the overall sigma
  int cell_px = 0;
  double scatter = 0;     ///< standard deviation of ln sigma between cells, chance taken out
  std::string covariate;  ///< what explains most of it: "u", "v", "distance from the centre", "depth", "fill"
  double explained = 0;   ///< share of that scatter (R^2 of a parabola); 0 where there is none
};

/// Squares in cells, frame after frame.
class CellVariance {
 public:
  CellVariance(const cv::Size& size, int cell_px);
  void add(const cv::Mat& residual_mm, const cv::Mat& valid);
  /// `covariance`: of the same noise, from which the effective number of samples a cell follows: ln s^2 of n pixels has
  /// the variance (2 sum over lags of rho^2 + excess kurtosis) / n. `depth_mm`: the plane's.
  Stationarity finish(const cv::Mat& covariance, double excess_kurtosis, const cv::Mat& depth_mm) const;

 private:
  int cell_px_, frames_ = 0;
  cv::Size size_;
  cv::Mat square_, count_;  // CV_64F
};

}  // namespace binrig
