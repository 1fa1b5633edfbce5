#include "calib/low_frequencies.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/polynomial_basis.h"
#include "compare/probability.h"
#include "core/error.h"

namespace binrig {

namespace {

// P(F > f) with d1 and d2 degrees of freedom.
double f_upper(double f, double d1, double d2) { return f <= 0 ? 1 : beta_lower(d2 / (d2 + d1 * f), d2 / 2, d1 / 2); }

}  // namespace

std::vector<double> order_powers(const cv::Mat& residual_mm, const cv::Mat& valid, int largest_order) {
  const cv::Rect box = cv::boundingRect(valid);
  // Order 12 has 12 half cycles a side: 96 pixels a side carry it with ease.
  const int block = std::max(1, std::min(box.width, box.height) / 96);
  const int rows = box.height / block, cols = box.width / block;
  cv::Mat means = cv::Mat::zeros(rows, cols, CV_32F), known = cv::Mat::zeros(rows, cols, CV_8U);
  for (int row = 0; row < rows; ++row)
    for (int col = 0; col < cols; ++col) {
      const cv::Rect place(box.x + col * block, box.y + row * block, block, block);
      const int n = cv::countNonZero(valid(place));
      if (2 * n < block * block) continue;
      means.at<float>(row, col) = static_cast<float>(cv::sum(residual_mm(place))[0] / n);
      known.at<std::uint8_t>(row, col) = 255;
    }
  for (int order = largest_order; order >= 1; --order) {
    try {
      const PolynomialBasis basis(known, order);
      const Eigen::VectorXd coefficients = basis.coefficients(means);
      std::vector<double> powers(order + 1, 0.0);
      for (int f = 0; f < basis.size(); ++f)
        powers[basis.order_of(f)] += coefficients[f] * coefficients[f] / (basis.order_of(f) + 1);
      return powers;
    } catch (const Error&) {
      // Too small or too thin a region for this order.
    }
  }
  return {};
}

LowFrequencies choose_drop_order(const std::vector<std::vector<double>>& powers, const std::vector<double>& sigma_mm) {
  LowFrequencies result;
  std::size_t orders = powers.empty() ? 0 : powers.front().size();
  for (const auto& p : powers) orders = std::min(orders, p.size());
  const int last = static_cast<int>(orders) - 4;  // the last order with three more above it
  if (last < 2) {
    result.reason = "only the plane: the region is too small to test more orders";
    return result;
  }
  std::vector<double> pooled(orders, 0.0);
  for (std::size_t i = 0; i < powers.size(); ++i)
    for (std::size_t o = 0; o < orders; ++o) pooled[o] += powers[i][o] / (sigma_mm[i] * sigma_mm[i]);
  const double level = 0.01 / (last - 1), captures = static_cast<double>(powers.size());
  std::size_t decisive = 0;
  for (int o = 2; o <= last; ++o) {
    double above = 0, functions = 0;
    for (int k = o + 1; k <= o + 3; ++k) above += (k + 1) * pooled[k], functions += k + 1;
    const double ratio = above > 0 ? pooled[o] / (above / functions) : 0;
    result.order.push_back(o);
    result.ratio.push_back(ratio);
    result.p_value.push_back(f_upper(ratio, captures * (o + 1), captures * functions));
    if (result.p_value.back() < level) result.drop_order = o, decisive = result.order.size() - 1;
  }
  result.plateau_found = result.drop_order < last;
  if (result.drop_order == 1) {
    const auto least = std::min_element(result.p_value.begin(), result.p_value.end()) - result.p_value.begin();
    result.reason = fmt::format(
        "only the plane: of orders 2 to {} none has more power than the three above it (order {} comes nearest: {:.2f} "
        "times, "
        "p = {:.2g} against {:.2g})",
        last, result.order[least], result.ratio[least], result.p_value[least], level);
  } else if (result.plateau_found) {
    result.reason = fmt::format(
        "orders up to {}: it is the last with more power than the three above it ({:.1f} times, p = {:.1g}); from "
        "order {} on "
        "the density is level",
        result.drop_order, result.ratio[decisive], result.p_value[decisive], result.drop_order + 1);
  } else {
    result.reason = fmt::format(
        "orders up to {}, the largest tried, where the power still rises towards low frequencies ({:.1f} times, p = "
        "{:.1g}): shape and noise cannot be told apart by frequency",
        result.drop_order, result.ratio.back(), result.p_value.back());
  }
  return result;
}

}  // namespace binrig
