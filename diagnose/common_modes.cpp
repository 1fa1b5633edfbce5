#include "diagnose/common_modes.h"

#include <cmath>

#include <Eigen/Eigenvalues>

namespace binrig {

CommonModes::CommonModes(const Block& block, const std::vector<bool>& known) : basis_(block.size, count) {
  for (int i = 0; i < block.size; ++i) {
    const float x = 2.f * static_cast<float>(i % block.cols) / block.cols - 1,
                y = 2.f * static_cast<float>(i / block.cols) / block.rows - 1;
    basis_.row(i) << 1, x, y, x * x, x * y, y * y;
    if (!known[i]) basis_.row(i).setZero();
  }
  for (int m = 0; m < count; ++m) {  // Gram and Schmidt, twice for precision
    for (int again = 0; again < 2; ++again)
      for (int k = 0; k < m; ++k) basis_.col(m) -= basis_.col(k).dot(basis_.col(m)) * basis_.col(k);
    const float length = basis_.col(m).norm();
    if (length > 1e-3f)
      basis_.col(m) /= length;
    else
      basis_.col(m).setZero();  // too little is known of the map to tell it from those before
  }
}

Eigen::Matrix<float, CommonModes::count, 1> CommonModes::coefficients(const float* map) const {
  return basis_.transpose() * Eigen::Map<const Eigen::VectorXf>(map, basis_.rows());
}

void CommonModes::apply(const Change& change, float* map) const {
  Eigen::Map<Eigen::VectorXf>(map, basis_.rows()) += basis_ * (change * coefficients(map));
}

CommonModes::Change CommonModes::learned_change(const Covariance& covariance) {
  constexpr double far_beyond = 8;
  const Eigen::SelfAdjointEigenSolver<Covariance> own(covariance);
  Eigen::Matrix<double, count, 1> change;
  for (int m = 0; m < count; ++m) {
    const double variance = own.eigenvalues()[m];
    change[m] = variance > far_beyond ? 1 / std::sqrt(variance) - 1 : 0;
  }
  return (own.eigenvectors() * change.asDiagonal() * own.eigenvectors().transpose()).cast<float>();
}

}  // namespace binrig
