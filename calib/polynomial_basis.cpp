#include "calib/polynomial_basis.h"

#include <fmt/format.h>
#include <Eigen/Dense>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace binrig {

namespace {

// Legendre polynomials 0 .. order at the centres of n pixels of [-1, 1].
Eigen::MatrixXd legendre(int n, int order) {
  Eigen::MatrixXd values(n, order + 1);
  for (int i = 0; i < n; ++i) {
    const double t = (2.0 * i + 1) / n - 1;
    values(i, 0) = 1;
    if (order > 0) values(i, 1) = t;
    for (int k = 2; k <= order; ++k)
      values(i, k) = ((2 * k - 1) * t * values(i, k - 1) - (k - 1) * values(i, k - 2)) / k;
  }
  return values;
}

}  // namespace

PolynomialBasis::PolynomialBasis(const cv::Mat& valid, int order) : valid_(valid), box_(cv::boundingRect(valid)) {
  for (int total = 0; total <= order; ++total)
    for (int q = 0; q <= total; ++q) degrees_.push_back({total - q, q});
  const int pixels = cv::countNonZero(valid);
  if (pixels < 2 * size())
    throw Error(fmt::format("{} valid pixels are too few to remove {} low frequencies from", pixels, size()));
  legendre_x_ = legendre(box_.width, order);
  legendre_y_ = legendre(box_.height, order);
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(size(), size());
  Eigen::MatrixXd values;
  std::vector<int> cols;
  for (int row = 0; row < box_.height; ++row) {
    row_of_values(row, values, cols);
    gram.selfadjointView<Eigen::Lower>().rankUpdate(values);
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(gram.selfadjointView<Eigen::Lower>());
  lower_ = factor.matrixL();
  if (factor.info() != Eigen::Success || !(lower_.diagonal().minCoeff() > 1e-6 * lower_.diagonal().maxCoeff()))
    throw Error("the low frequencies cannot be told apart on this region: it is too thin");
}

void PolynomialBasis::row_of_values(int row, Eigen::MatrixXd& values, std::vector<int>& cols) const {
  cols.clear();
  const std::uint8_t* inside = valid_.ptr<std::uint8_t>(box_.y + row);
  for (int col = 0; col < box_.width; ++col)
    if (inside[box_.x + col] != 0) cols.push_back(col);
  values.resize(size(), static_cast<Eigen::Index>(cols.size()));
  for (std::size_t i = 0; i < cols.size(); ++i)
    for (int f = 0; f < size(); ++f)
      values(f, static_cast<Eigen::Index>(i)) = legendre_x_(cols[i], degrees_[f][0]) * legendre_y_(row, degrees_[f][1]);
}

std::array<double, 2> PolynomialBasis::frequency(int function) const {
  return {0.5 * degrees_[function][0] / box_.width, 0.5 * degrees_[function][1] / box_.height};
}

Eigen::VectorXd PolynomialBasis::coefficients(const cv::Mat& image) const {
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(size());
  Eigen::MatrixXd values;
  std::vector<int> cols;
  for (int row = 0; row < box_.height; ++row) {
    row_of_values(row, values, cols);
    const float* pixels = image.ptr<float>(box_.y + row) + box_.x;
    Eigen::VectorXd line(static_cast<Eigen::Index>(cols.size()));
    for (std::size_t i = 0; i < cols.size(); ++i) line[static_cast<Eigen::Index>(i)] = pixels[cols[i]];
    sums += values * line;
  }
  return lower_.triangularView<Eigen::Lower>().solve(sums);
}

cv::Mat PolynomialBasis::remainder(const cv::Mat& image) const {
  const Eigen::VectorXd weights = lower_.transpose().triangularView<Eigen::Upper>().solve(coefficients(image));
  cv::Mat result = cv::Mat::zeros(image.size(), CV_32F);
  Eigen::MatrixXd values;
  std::vector<int> cols;
  for (int row = 0; row < box_.height; ++row) {
    row_of_values(row, values, cols);
    const Eigen::VectorXd fitted = values.transpose() * weights;
    const float* from = image.ptr<float>(box_.y + row) + box_.x;
    float* to = result.ptr<float>(box_.y + row) + box_.x;
    for (std::size_t i = 0; i < cols.size(); ++i)
      to[cols[i]] = static_cast<float>(from[cols[i]] - fitted[static_cast<Eigen::Index>(i)]);
  }
  return result;
}

cv::Mat PolynomialBasis::function(int index) const {
  Eigen::VectorXd unit = Eigen::VectorXd::Zero(size());
  unit[index] = 1;
  const Eigen::VectorXd weights = lower_.transpose().triangularView<Eigen::Upper>().solve(unit);
  cv::Mat result = cv::Mat::zeros(valid_.size(), CV_32F);
  Eigen::MatrixXd values;
  std::vector<int> cols;
  for (int row = 0; row < box_.height; ++row) {
    row_of_values(row, values, cols);
    const Eigen::VectorXd line = values.transpose() * weights;
    float* to = result.ptr<float>(box_.y + row) + box_.x;
    for (std::size_t i = 0; i < cols.size(); ++i) to[cols[i]] = static_cast<float>(line[static_cast<Eigen::Index>(i)]);
  }
  return result;
}

}  // namespace binrig
