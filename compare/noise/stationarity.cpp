#include "compare/noise/stationarity.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <Eigen/Dense>

namespace binrig {

CellVariance::CellVariance(const cv::Size& size, int cell_px)
    : cell_px_(cell_px),
      size_(size),
      square_((size.height + cell_px - 1) / cell_px, (size.width + cell_px - 1) / cell_px, CV_64F, cv::Scalar(0)),
      count_(square_.size(), CV_64F, cv::Scalar(0)) {}

void CellVariance::add(const cv::Mat& residual, const cv::Mat& valid) {
  ++frames_;
  for (int r = 0; r < residual.rows; ++r) {
    for (int c = 0; c < residual.cols; ++c) {
      if (!valid.at<std::uint8_t>(r, c)) continue;
      const double e = residual.at<float>(r, c);
      square_.at<double>(r / cell_px_, c / cell_px_) += e * e;
      count_.at<double>(r / cell_px_, c / cell_px_) += 1;
    }
  }
}

Stationarity CellVariance::finish(const cv::Mat& covariance, double excess_kurtosis, const cv::Mat& depth_mm) const {
  Stationarity out;
  out.cell_px = cell_px_;
  TestResult& test = out.equal_everywhere;
  test.name = "noise is equally strong everywhere";
  test.method = "chi-square of the logarithms of the cells' variances";
  const int middle = covariance.rows / 2;
  const double variance = covariance.at<double>(middle, middle);
  if (!(variance > 0)) return out;
  double lags = 0;
  for (int dy = -std::min(16, middle); dy <= std::min(16, middle); ++dy) {
    for (int dx = -std::min(16, middle); dx <= std::min(16, middle); ++dx) {
      lags += std::pow(covariance.at<double>(middle + dy, middle + dx) / variance, 2);
    }
  }
  const double inflation = std::max(0.5, 2 * lags + std::max(-1.0, excess_kurtosis));
  struct Cell {
    double log_variance, weight, u, v, radius, depth, fill;
    int row, col;
  };
  std::vector<Cell> cells;
  for (int r = 0; r < square_.rows; ++r) {
    for (int c = 0; c < square_.cols; ++c) {
      const double n = count_.at<double>(r, c), s = square_.at<double>(r, c);
      const double full = static_cast<double>(cell_px_) * cell_px_ * frames_;
      // Below 20 effective samples the logarithm is biased by more than 5 %.
      if (n < 20 * inflation / 2 || n < full / 4 || !(s > 0)) continue;
      const double u = (c + 0.5) * cell_px_, v = (r + 0.5) * cell_px_;
      const int row = std::min(size_.height - 1, static_cast<int>(v)),
                col = std::min(size_.width - 1, static_cast<int>(u));
      cells.push_back({std::log(s / n), n / inflation, u, v, std::hypot(u - 0.5 * size_.width, v - 0.5 * size_.height),
                       depth_mm.at<float>(row, col), n / full, r, c});
    }
  }
  if (cells.size() < 8) {
    test.method = "not done: too few cells";
    return out;
  }
  double weight = 0, mean = 0;
  for (const Cell& c : cells) {
    weight += c.weight;
    mean += c.weight * c.log_variance;
  }
  mean /= weight;
  test.map = cv::Mat(square_.size(), CV_32F, cv::Scalar(0));
  test.map_meaning = "standard deviation in a cell over that of the whole region";
  double between = 0;
  for (const Cell& c : cells) {
    test.statistic += c.weight * std::pow(c.log_variance - mean, 2);
    between += c.weight * std::pow(c.log_variance - mean, 2);
    test.map.at<float>(c.row, c.col) = static_cast<float>(std::exp(0.5 * (c.log_variance - mean)));
  }
  const double cells_count = static_cast<double>(cells.size());
  test.degrees_of_freedom = cells_count - 1;
  test.effective_n = weight;
  test.threshold = chi_square_threshold(test.level, test.degrees_of_freedom);
  test.p_value = chi_square_upper(test.statistic, test.degrees_of_freedom);
  test.done = true;
  // Chance alone makes between = cells - 1.
  const double excess = std::max(0.0, between - test.degrees_of_freedom);
  out.scatter = 0.5 * std::sqrt(excess / weight);
  if (!test.rejected() || excess <= 0) return out;
  const std::pair<const char*, std::function<double(const Cell&)>> covariates[] = {
      {"u", [](const Cell& c) { return c.u; }},
      {"v", [](const Cell& c) { return c.v; }},
      {"distance from the centre", [](const Cell& c) { return c.radius; }},
      {"depth", [](const Cell& c) { return c.depth; }},
      {"fill", [](const Cell& c) { return c.fill; }}};
  for (const auto& [name, value] : covariates) {
    double low = 1e300, high = -1e300;
    for (const Cell& c : cells) {
      low = std::min(low, value(c));
      high = std::max(high, value(c));
    }
    if (high - low < 1e-9) continue;
    Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-9;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Cell& c : cells) {
      const double x = 2 * (value(c) - low) / (high - low) - 1;
      const Eigen::Vector3d g(1, x, x * x);
      normal += c.weight * g * g.transpose();
      right += c.weight * (c.log_variance - mean) * g;
    }
    // Two more parameters explain 2 of the statistic by chance.
    const double share = (right.dot(normal.ldlt().solve(right)) - 2) / excess;
    if (share > out.explained) {
      out.explained = std::min(1.0, share);
      out.covariate = name;
    }
  }
  return out;
}

}  // namespace binrig
