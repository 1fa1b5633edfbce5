// What the elements of a map have in common from recording to recording.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnose/experiment.h"

namespace binrig {

/// Elements of a map that move together from recording to recording: where frames shake as wholes, the few there are of a
/// capture make its whole noise map larger or smaller, and its sides. Taken for independent, its thousand elements would
/// say thirty times too precisely how strong noise is. Six modes (1, x, y, x^2, xy, y^2 over the image) are whitened by
/// their covariance among simulations, where they scatter far more than independent elements make them. Everything is in
/// units of the elements' own spread; nothing throws. Source: plain whitening of a few linear combinations by their
/// eigenvectors; which ones, and from where on they count, is ours.
class CommonModes {
 public:
  static constexpr int count = 6;
  using Covariance = Eigen::Matrix<double, count, count>;
  using Change = Eigen::Matrix<float, count, count>;

  /// `known`: elements of the block that count.
  CommonModes(const Block& block, const std::vector<bool>& known);
  /// Coefficients of a map: independent elements of unit variance give independent ones of unit variance.
  Eigen::Matrix<float, count, 1> coefficients(const float* map) const;
  /// Multiplies a map's coefficients by 1 + `change`, in place. `change`: of learned_change to whiten it, its inverse to
  /// take that back.
  void apply(const Change& change, float* map) const;
  /// What coefficients of this covariance have to be multiplied by to have none, less 1. Modes that scatter by less than
  /// eight times what independent elements make stay: noise that is correlated over a few pixels makes two to four, and
  /// weights that are not the best ones cost it nothing else. All 0 if all stay.
  static Change learned_change(const Covariance& covariance);

 private:
  Eigen::MatrixXf basis_;  // elements x modes, orthonormal; 0 where unknown
};

}  // namespace binrig
