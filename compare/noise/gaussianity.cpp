#include "compare/noise/gaussianity.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

namespace binrig {

namespace {

constexpr int fewest_values = 100;

struct Moments {
  double mean = 0, sigma = 0;
};

Moments moments_of(const std::vector<float>& values) {
  Moments m;
  for (const float x : values) m.mean += x;
  m.mean /= values.size();
  for (const float x : values) m.sigma += (x - m.mean) * (x - m.mean);
  m.sigma = std::sqrt(m.sigma / values.size());  // the maximum likelihood estimate, as Y^2 wants it
  return m;
}

}  // namespace

TestResult gaussianity(const std::vector<float>& values) {
  TestResult result;
  result.name = "noise is Gaussian";
  const double n = static_cast<double>(values.size());
  result.effective_n = n;
  result.method = "chi-square of normality (Rao-Robson-Nikulin) on pixels far enough apart to be independent";
  if (values.size() < fewest_values) {
    result.method = "not done: fewer than 100 independent values";
    return result;
  }
  const Moments m = moments_of(values);
  if (!(m.sigma > 0)) {
    result.method = "not done: the values do not differ";
    return result;
  }
  const int k = std::clamp(static_cast<int>(2 * std::pow(n, 0.4)), 8, 40);
  std::vector<double> edge(k - 1), density(k + 1, 0), moment(k + 1, 0), count(k, 0);
  for (int j = 1; j < k; ++j) {
    edge[j - 1] = normal_quantile(static_cast<double>(j) / k);
    density[j] = std::exp(-0.5 * edge[j - 1] * edge[j - 1]) / std::sqrt(2 * CV_PI);
    moment[j] = edge[j - 1] * density[j];
  }
  for (const float x : values) {
    count[std::upper_bound(edge.begin(), edge.end(), (x - m.mean) / m.sigma) - edge.begin()] += 1;
  }
  double v1 = 0, v2 = 0, c1 = 0, c2 = 0;
  const double expected = n / k;
  result.map.create(1, k, CV_32F);
  result.map_meaning = "count minus expected count over its root, cell by cell from the lowest to the highest values";
  for (int j = 0; j < k; ++j) {
    result.statistic += (count[j] - expected) * (count[j] - expected) / expected;
    result.map.at<float>(0, j) = static_cast<float>((count[j] - expected) / std::sqrt(expected));
    const double shift = density[j] - density[j + 1], stretch = moment[j] - moment[j + 1];
    v1 += k * count[j] * shift;
    v2 += k * count[j] * stretch;
    c1 += k * shift * shift;
    c2 += k * stretch * stretch;
  }
  result.statistic += (v1 * v1 / (1 - c1) + v2 * v2 / (2 - c2)) / n;
  result.degrees_of_freedom = k - 1;
  result.threshold = chi_square_threshold(result.level, k - 1);
  result.p_value = chi_square_upper(result.statistic, k - 1);
  result.done = true;
  return result;
}

TestResult same_distribution(const std::vector<float>& first, const std::vector<float>& second, bool standardised) {
  TestResult result;
  result.name = standardised ? "shapes of the distributions agree" : "distributions agree";
  result.method = "two-sample chi-square in cells of equal share of the pooled sample, on independent pixels";
  const double n1 = static_cast<double>(first.size()), n2 = static_cast<double>(second.size());
  result.effective_n = n1 + n2 > 0 ? n1 * n2 / (n1 + n2) : 0;
  if (std::min(n1, n2) < fewest_values) {
    result.method = "not done: fewer than 100 independent values";
    return result;
  }
  Moments a, b;
  a.sigma = b.sigma = 1;
  if (standardised) {
    a = moments_of(first);
    b = moments_of(second);
  }
  if (!(a.sigma > 0 && b.sigma > 0)) {
    result.method = "not done: the values do not differ";
    return result;
  }
  std::vector<double> one, two, pooled;
  for (const float x : first) one.push_back((x - a.mean) / a.sigma);
  for (const float x : second) two.push_back((x - b.mean) / b.sigma);
  pooled = one;
  pooled.insert(pooled.end(), two.begin(), two.end());
  std::sort(pooled.begin(), pooled.end());
  const int wanted = std::clamp(static_cast<int>(2 * std::pow(std::min(n1, n2), 0.4)), 8, 40);
  // Quantised values make equal edges: cells between them would be empty and are joined.
  std::vector<double> edge;
  for (int j = 1; j < wanted; ++j) {
    const double e = pooled[pooled.size() * j / wanted];
    if (edge.empty() || e > edge.back()) edge.push_back(e);
  }
  const int k = static_cast<int>(edge.size()) + 1;
  std::vector<double> count1(k, 0), count2(k, 0);
  for (const double x : one) count1[std::upper_bound(edge.begin(), edge.end(), x) - edge.begin()] += 1;
  for (const double x : two) count2[std::upper_bound(edge.begin(), edge.end(), x) - edge.begin()] += 1;
  const double up = std::sqrt(n2 / n1), down = std::sqrt(n1 / n2);
  result.map = cv::Mat(1, k, CV_32F, cv::Scalar(0));
  result.map_meaning = "standardised difference of the counts, cell by cell from the lowest to the highest values";
  int used = 0;
  for (int j = 0; j < k; ++j) {
    if (count1[j] + count2[j] <= 0) continue;
    const double z = (up * count1[j] - down * count2[j]) / std::sqrt(count1[j] + count2[j]);
    result.map.at<float>(0, j) = static_cast<float>(z);
    result.statistic += z * z;
    ++used;
  }
  if (used < 2) {
    result.method = "not done: all values fall into one cell";
    return result;
  }
  result.degrees_of_freedom = used - 1;
  result.threshold = chi_square_threshold(result.level, result.degrees_of_freedom);
  result.p_value = chi_square_upper(result.statistic, result.degrees_of_freedom);
  result.done = true;
  return result;
}

Thinning thinning(const cv::Mat& covariance, const cv::Mat& pairs) {
  const int middle = covariance.rows / 2;
  const double variance = covariance.at<double>(middle, middle);
  Thinning out;
  if (!(variance > 0)) return out;
  const double chance = 3 / std::sqrt(std::max(1.0, pairs.at<double>(middle, middle)));
  const auto lattice = [&](int spacing, auto&& visit) {
    // Beyond three steps what is measured is chance alone, and the third power of what is there is nothing.
    const int steps = std::min(3, middle / spacing);
    for (int i = -steps; i <= steps; ++i) {
      for (int j = -steps; j <= steps; ++j) {
        if (i || j) visit(std::abs(covariance.at<double>(middle + i * spacing, middle + j * spacing)) / variance);
      }
    }
  };
  for (out.for_normality = 1; out.for_normality < middle; ++out.for_normality) {
    double sum = 0;
    lattice(out.for_normality, [&](double rho) { sum += rho * rho * rho; });
    if (sum <= 0.02) break;
  }
  for (out.for_comparison = out.for_normality; out.for_comparison < middle; ++out.for_comparison) {
    double largest = 0;
    lattice(out.for_comparison, [&](double rho) { largest = std::max(largest, rho); });
    if (largest <= std::max(0.03, chance)) break;
  }
  return out;
}

void collect(const cv::Mat& residual, const cv::Mat& valid, int spacing, std::vector<float>& values) {
  for (int r = 0; r < residual.rows; r += spacing) {
    const auto* e = residual.ptr<float>(r);
    const auto* m = valid.ptr<std::uint8_t>(r);
    for (int c = 0; c < residual.cols; c += spacing) {
      if (m[c]) values.push_back(e[c]);
    }
  }
}

TestResult gaussianity(const cv::Mat& residual, const cv::Mat& valid) {
  const cv::Rect box = cv::boundingRect(valid);
  Autocovariance autocovariance(std::min(24, suitable_max_lag(box.size())));
  autocovariance.add(residual(box), valid(box));
  const Thinning spacing = thinning(autocovariance.covariance(), autocovariance.pairs());
  std::vector<float> values;
  collect(residual, valid, spacing.for_normality, values);
  return gaussianity(values);
}

}  // namespace binrig
