// Polynomials in image coordinates, orthonormal on a region of any shape.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

namespace binrig {

/// Products of Legendre polynomials P_p(u) P_q(v), p + q <= order, over the bounding box of a mask, made orthonormal on
/// the mask by Gram-Schmidt in the order of p + q, so that lower orders do not depend on higher ones. Order 1 is the
/// plane.
class PolynomialBasis {
 public:
  /// valid: CV_8U. Throws Error if the mask has fewer than twice as many pixels as functions, or they are not
  /// independent on it.
  PolynomialBasis(const cv::Mat& valid, int order);

  int size() const { return static_cast<int>(degrees_.size()); }
  int order_of(int function) const { return degrees_[function][0] + degrees_[function][1]; }
  /// Nominal frequency (cycles/px) in x and y: half a cycle per degree and box.
  std::array<double, 2> frequency(int function) const;

  /// Coefficients of an image (CV_32F) on the mask: inner products with the orthonormal functions.
  Eigen::VectorXd coefficients(const cv::Mat& image) const;
  /// image minus its projection, 0 outside the mask. CV_32F.
  cv::Mat remainder(const cv::Mat& image) const;
  /// One orthonormal function, 0 outside the mask. CV_32F.
  cv::Mat function(int index) const;

 private:
  cv::Mat combination(const Eigen::VectorXd& coefficients) const;

  cv::Mat valid_;
  cv::Rect box_;
  std::vector<std::array<int, 2>> degrees_;
  Eigen::MatrixXd legendre_x_, legendre_y_;  // pixel by degree
  Eigen::MatrixXd lower_;                    // Cholesky factor of the Gram matrix
};

}  // namespace binrig
