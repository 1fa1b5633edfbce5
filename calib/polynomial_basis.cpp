#include "calib/polynomial_basis.h"

#include <algorithm>

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
  // The functions are products: the moments of a row along x, then the row's powers along y.
  const int n = order + 1;
  const Eigen::MatrixXd full_row = legendre_x_.transpose() * legendre_x_;
  Eigen::MatrixXd moments(n, n), masked(box_.width, n), gram = Eigen::MatrixXd::Zero(size(), size());
  for (int row = 0; row < box_.height; ++row) {
    const std::uint8_t* inside = valid_.ptr<std::uint8_t>(box_.y + row) + box_.x;
    const auto holes = std::count(inside, inside + box_.width, 0);
    if (holes == box_.width) continue;
    if (holes == 0) {
      moments = full_row;
    } else {
      for (int col = 0; col < box_.width; ++col) {
        if (inside[col] != 0)
          masked.row(col) = legendre_x_.row(col);
        else
          masked.row(col).setZero();
      }
      moments.noalias() = masked.transpose() * legendre_x_;
    }
    for (int f = 0; f < size(); ++f)
      for (int g = 0; g <= f; ++g)
        gram(f, g) += moments(degrees_[f][0], degrees_[g][0]) * legendre_y_(row, degrees_[f][1]) *
                      legendre_y_(row, degrees_[g][1]);
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(gram.selfadjointView<Eigen::Lower>());
  lower_ = factor.matrixL();
  if (factor.info() != Eigen::Success || !(lower_.diagonal().minCoeff() > 1e-6 * lower_.diagonal().maxCoeff()))
    throw Error("the low frequencies cannot be told apart on this region: it is too thin");
}

std::array<double, 2> PolynomialBasis::frequency(int function) const {
  return {0.5 * degrees_[function][0] / box_.width, 0.5 * degrees_[function][1] / box_.height};
}

Eigen::VectorXd PolynomialBasis::coefficients(const cv::Mat& image) const {
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(size()), line(box_.width), along_x(legendre_x_.cols());
  for (int row = 0; row < box_.height; ++row) {
    const std::uint8_t* inside = valid_.ptr<std::uint8_t>(box_.y + row) + box_.x;
    const float* pixels = image.ptr<float>(box_.y + row) + box_.x;
    for (int col = 0; col < box_.width; ++col) line[col] = inside[col] != 0 ? pixels[col] : 0.0;
    along_x.noalias() = legendre_x_.transpose() * line;
    for (int f = 0; f < size(); ++f) sums[f] += along_x[degrees_[f][0]] * legendre_y_(row, degrees_[f][1]);
  }
  return lower_.triangularView<Eigen::Lower>().solve(sums);
}

cv::Mat PolynomialBasis::combination(const Eigen::VectorXd& coefficients) const {
  const Eigen::VectorXd weights = lower_.transpose().triangularView<Eigen::Upper>().solve(coefficients);
  cv::Mat result = cv::Mat::zeros(valid_.size(), CV_32F);
  Eigen::VectorXd line(box_.width), along_x(legendre_x_.cols());
  for (int row = 0; row < box_.height; ++row) {
    along_x.setZero();
    for (int f = 0; f < size(); ++f) along_x[degrees_[f][0]] += weights[f] * legendre_y_(row, degrees_[f][1]);
    line.noalias() = legendre_x_ * along_x;
    const std::uint8_t* inside = valid_.ptr<std::uint8_t>(box_.y + row) + box_.x;
    float* to = result.ptr<float>(box_.y + row) + box_.x;
    for (int col = 0; col < box_.width; ++col) to[col] = inside[col] != 0 ? static_cast<float>(line[col]) : 0.f;
  }
  return result;
}

cv::Mat PolynomialBasis::remainder(const cv::Mat& image) const {
  cv::Mat result = cv::Mat::zeros(image.size(), CV_32F);
  cv::subtract(image, combination(coefficients(image)), result, valid_);
  return result;
}

cv::Mat PolynomialBasis::function(int index) const {
  Eigen::VectorXd unit = Eigen::VectorXd::Zero(size());
  unit[index] = 1;
  return combination(unit);
}

}  // namespace binrig
