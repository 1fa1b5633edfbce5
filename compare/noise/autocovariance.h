// The autocovariance of an image with holes, and how well it is known.
//
// For every lag k = (dy, dx): C(k) = sum over pixels p with p and p + k both valid of e(p) e(p + k), divided by the
// number of such pairs. The division takes the mask's own correlation out, so holes and ragged regions leave C unbiased
// (as long as holes do not depend on the noise). Computed by zero-padded DFTs of tiles; tiles fall into groups, and the
// spread of the estimates that leave one group out (jackknife: Efron 1982) says how well anything computed from C is
// known, whatever the noise's distribution and correlation, as long as it is shorter than a tile.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/spectrum.h"

namespace binrig {

/// Sums over pairs for all lags |dy|, |dx| <= max_lag; row-wise (2 max_lag + 1) squared.
struct PairSums {
  std::vector<double> products, pairs;
};

/// A quantity with its standard error.
struct Estimate {
  double value = 0, standard_error = 0;
  double degrees_of_freedom = 0;  ///< of the standard error: groups - 1
};

class Autocovariance {
 public:
  /// Lags up to max_lag px are kept; tiles are twice as large. `groups` >= 2 jackknife groups.
  explicit Autocovariance(int max_lag, int groups = 24);

  /// residual: CV_32F, mean about zero; valid: CV_8U, not 0 = counts. Tiles with less than a tenth of their pixels
  /// valid are left out. A tile of the same place in up to 16 successive frames goes to the same group, so that noise
  /// which lasts over some frames does not pass for so many independent samples.
  void add(const cv::Mat& residual, const cv::Mat& valid);
  int max_lag() const { return max_lag_; }
  int groups_used() const;
  /// Valid pixels added.
  double pixels() const;

  /// CV_64F (2 max_lag + 1)^2, mm^2; row dy + max_lag, column dx + max_lag; lags without 50 pairs are 0.
  cv::Mat covariance() const;
  /// CV_64F, number of pairs a lag.
  cv::Mat pairs() const;
  /// covariance() with one group left out.
  cv::Mat covariance_without(int group) const;

  /// A function of the covariance with its jackknife standard error. Values come back in the function's own order.
  std::vector<Estimate> estimate(const std::function<std::vector<double>(const cv::Mat& covariance)>& function) const;

 private:
  cv::Mat covariance_of(const PairSums& sums) const;
  int max_lag_, tile_;
  std::vector<PairSums> groups_;
  std::vector<double> group_pixels_;
  int frame_ = 0;
  std::shared_ptr<Fft2> fft_;
};

/// The largest lag that a region is good for: 64 px, less where the region is small (an eighth of its shorter side, at
/// least 8), so that at least 16 tiles say how well the result is known.
int suitable_max_lag(const cv::Size& region_box);

}  // namespace binrig
