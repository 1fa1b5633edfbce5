#include "compare/noise/whiteness.h"

#include <cmath>

namespace binrig {

TestResult whiteness(const cv::Mat& covariance, const cv::Mat& pairs) {
  constexpr int reach = 4;
  TestResult result;
  result.name = "pixels are independent (white)";
  result.method = "Box-Pierce sum of squared autocorrelations over the 40 lags of a half plane within 4 px";
  const int middle = covariance.rows / 2;
  const double variance = covariance.at<double>(middle, middle);
  result.effective_n = pairs.at<double>(middle, middle);
  if (!(variance > 0) || result.effective_n < 500 || middle < reach) return result;
  result.map.create(2 * reach + 1, 2 * reach + 1, CV_32F);
  result.map_meaning = "autocorrelation at lags of -4 .. 4 px";
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) {
      const double rho = covariance.at<double>(middle + dy, middle + dx) / variance;
      result.map.at<float>(dy + reach, dx + reach) = static_cast<float>(rho);
      if (dy < 0 || (dy == 0 && dx <= 0)) continue;
      result.statistic += pairs.at<double>(middle + dy, middle + dx) * rho * rho;
      result.degrees_of_freedom += 1;
    }
  }
  result.threshold = chi_square_threshold(result.level, result.degrees_of_freedom);
  result.p_value = chi_square_upper(result.statistic, result.degrees_of_freedom);
  result.done = true;
  return result;
}

TestResult whiteness(const Autocovariance& autocovariance) {
  return whiteness(autocovariance.covariance(), autocovariance.pairs());
}

std::vector<double> radial_autocorrelation(const cv::Mat& covariance) {
  const int middle = covariance.rows / 2;
  std::vector<double> sum(middle + 1), count(middle + 1);
  const double variance = covariance.at<double>(middle, middle);
  if (!(variance > 0)) return {};
  for (int dy = -middle; dy <= middle; ++dy) {
    for (int dx = -middle; dx <= middle; ++dx) {
      const int d = static_cast<int>(std::lround(std::hypot(dx, dy)));
      if (d > middle) continue;
      sum[d] += covariance.at<double>(middle + dy, middle + dx) / variance;
      count[d] += 1;
    }
  }
  for (int d = 0; d <= middle; ++d) sum[d] /= count[d];
  return sum;
}

double correlation_length_px(const cv::Mat& covariance) {
  const auto rho = radial_autocorrelation(covariance);
  const double level = std::exp(-1.0);
  for (std::size_t d = 1; d < rho.size(); ++d) {
    if (rho[d] <= level) return d - 1 + (rho[d - 1] - level) / (rho[d - 1] - rho[d]);
  }
  return rho.empty() ? 0 : static_cast<double>(rho.size() - 1);
}

}  // namespace binrig
