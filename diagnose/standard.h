// From statistics to numbers that compare: standardised by the model's own randomness, whitened, compressed.
#pragma once

#include <map>
#include <vector>

#include <Eigen/Core>

#include "diagnose/common_modes.h"
#include "diagnose/experiment.h"

namespace binrig {

/// A vector of the layout's size in which the model's own simulations have about unit variance everywhere.
using Whitened = std::vector<float>;

class Standard {
 public:
  Standard() = default;
  /// Learned from simulations of one model (at least 4). `known_shift`, if given, holds for each simulation the change
  /// of its bias maps that its random pose makes (0 elsewhere); it is taken out before the spread is measured, since
  /// poses are marginalised later (diagnose/metric.h). Elements that `measured` does not know do not count: they would
  /// be taken for measured without a residual.
  Standard(const Layout& layout, const StatVector& measured, const std::vector<StatVector>& simulations,
           const std::vector<StatVector>& known_shift = {});

  bool empty() const { return mean_.empty(); }
  const Layout& layout() const { return *layout_; }
  /// y of a recording: whitened difference to the mean. Unknown elements are 0.
  Whitened linear(const StatVector& statistics) const;
  /// The same, compressed.
  Whitened standardise(const StatVector& statistics) const;
  /// Whitened small difference of two statistics (a derivative times a step): no mean taken off, not compressed.
  Whitened difference(const StatVector& a) const;
  const StatVector& mean() const { return mean_; }
  /// True if maps whose elements move together have been whitened for that (CommonModes).
  bool has_modes() const { return !modes_.empty(); }
  /// A whitened vector with these modes given back: every element in units of its own spread. What a map that moves as
  /// a whole says is less than it seems; what is wrong with it is not.
  Whitened with_modes(Whitened y) const;
  /// ln of the determinant of the covariance of a block's known elements (index in the layout), by which with_modes(
  /// difference()) whitens them: what their spreads make, less what is known of them from each other. 0 if none is known.
  double log_determinant(std::size_t block) const;
  /// Standard deviation of each element before whitening, floor included; 0 = unknown.
  const std::vector<float>& spread() const { return spread_; }

 private:
  void whiten(Whitened& values) const;

  const Layout* layout_ = nullptr;
  StatVector mean_;
  std::vector<float> spread_;
  std::vector<Eigen::MatrixXf> small_;  // by block: inverse Cholesky factor of the correlation; empty for maps
  std::vector<float> ring_gain_;        // of the bias maps' whitening filter, by ring of frequency
  std::map<std::size_t, CommonModes> modes_;  // by block: of the noise maps, if they move together
  CommonModes::Change calm_;                  // what whitens these
};

/// 8 asinh(r / 8), element by element: no single segment outvotes all others.
void compress(Whitened& residual);
void uncompress(Whitened& residual);  ///< its inverse
/// The slope of that, by which derivatives are multiplied.
float compression_slope(float compressed);

double dot(const Whitened& a, const Whitened& b);

/// How far off a residual is where something unknown is missing: ln of the mean square (at least 1) of every block's
/// elements that are known (not 0), averaged over blocks, times the number of those elements. A normal likelihood in
/// which each block's variance is profiled out, and in which a block's elements say one thing together: they are off
/// together, so that a hundredth of a large map counts less than half of a few lines. 0 if nothing is known.
double misfit_by_blocks(const Layout& layout, const Whitened& residual);

/// Mean square of the capture in the middle, bias left out; 0 if nothing is known. Where few captures are far from the
/// model, this is what all the others leave.
double left_by_most_captures(const Layout& layout, const Whitened& residual);

}  // namespace binrig
