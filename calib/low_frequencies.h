// How many of the lowest spatial frequencies of plane residuals are shape and not noise.
//
// Sun et al. 2009 drop "the low frequencies" by hand: a board is not flat, a lens is not perfect. Here a test decides.
// The residual's coefficients in an orthonormal polynomial basis (polynomial_basis.h) all have the variance S(f) of the
// noise at their frequency; the noise's density is flat below the inverse of its correlation length, shape rises
// steeply towards order 0. So, order by order:
// is the mean square of its coefficients larger than that of the next three orders (F test, corrected for the number of
// orders)? The last order for which it is, and all below it, are dropped.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace binrig {

struct LowFrequencies {
  int drop_order = 1;         ///< K: orders 0 .. K are dropped; 1 = only the plane
  bool plateau_found = true;  ///< false: still rising at the largest order tried
  std::vector<int> order;     ///< orders tested
  std::vector<double> ratio;  ///< mean square over that of the next three orders
  std::vector<double> p_value;
  std::string reason;  ///< in one sentence
};

/// Mean squares of a residual's coefficients by order, 0 .. largest; blocks of pixels are averaged first, which changes
/// no low frequency and saves time. residual_mm: CV_32F, valid: CV_8U. Fewer orders where the region is too small.
std::vector<double> order_powers(const cv::Mat& residual_mm, const cv::Mat& valid, int largest_order = 12);

/// One decision for several residuals (one a capture, since frames of one capture share their shape). Each is divided
/// by its own scale `sigma_mm`, so that noisy captures do not decide alone. Orders 2 .. largest - 3 are tested at 1 %,
/// divided by their number.
LowFrequencies choose_drop_order(const std::vector<std::vector<double>>& powers, const std::vector<double>& sigma_mm);

}  // namespace binrig
