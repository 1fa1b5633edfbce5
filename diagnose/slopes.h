// What derivatives that carry the noise of a few simulations say together.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "diagnose/metric.h"

namespace binrig {

/// Derivatives by parameter, each once a seed.
using SeedSlopes = std::vector<std::vector<Whitened>>;

/// Mean over seeds of whitened differences, and by segment the share of its square that is no noise: 1 with one seed, 0
/// where nothing changes.
struct SeedMean {
  Whitened mean;
  std::vector<double> signal;
};
SeedMean mean_over_seeds(const Layout& layout, const std::vector<Whitened>& by_seed);
/// The mean, each segment times its share of signal, or 0 where that is less than `least`.
Whitened shrunk(const Layout& layout, const SeedMean& mean, double least);

/// Gives all known elements of the maps of some segments (one flag a segment) their mean, block by block. `spread`: of
/// Standard, one an element, 0 = unknown.
void pool(const Layout& layout, const std::vector<float>& spread, const std::vector<bool>& segments, Whitened& change);
/// Pools whitened differences, each of a seed, in segments whose maps are noise element by element, their share of
/// signal less than `least`, but not in their mean: pixels toss for what they do (one in a hundred gets a tail).
/// Dropped from one parameter's derivative and not from another's, such a segment would have the second do what the
/// first should. Returns which segments were pooled.
std::vector<bool> pool_noisy(const Layout& layout, const std::vector<float>& spread, double least,
                             std::vector<Whitened>& by_seed);

/// How chi pulls at a parameter with derivative J. Nuisances are taken out of a residual, then it is compressed: what
/// is left, v = compress(u), changes by v' (QJ), and the nuisances' own prior by what Q took out of J. With the prior's
/// part, chi's gradient is -2 (J . u + QJ . (v v' - u)).
class Pull {
 public:
  /// `rest`: of Metric::explain.
  explicit Pull(const Whitened& rest);
  const Whitened& direct() const { return direct_; }  ///< u
  /// Minus half of chi's gradient; `direct`: u, or one from which a simulation's own noise was taken.
  double along(const Whitened& direct, const Whitened& slope, const Whitened& freed) const {
    return dot(slope, direct) + dot(freed, bent_);
  }
  /// Its inner product with another parameter's QJ is half of chi's second derivative.
  Whitened curved(const Whitened& slope, const Whitened& freed) const;

 private:
  Whitened direct_, bent_, lost_;  // lost_: 1 - v'^2
};

/// Inner products of the parameters' mean derivatives, one factor left and one right of them.
Eigen::MatrixXd products_of_means(const SeedSlopes& left, const SeedSlopes& right);
/// The same, taken only between derivatives of different seeds: their own noise must not pass for information, or a
/// direction in which parameters make up for each other would look short, and steps along it would stop half way. A
/// parameter without derivatives has zeros. Needs two seeds.
Eigen::MatrixXd unbiased_products(const SeedSlopes& left, const SeedSlopes& right);

/// Makes unbiased products positive: direction by direction (their own ones, parameters in units of `scale`; where
/// noise passes for information two parameters that make up for each other seem to do so at another rate), no less than
/// a twentieth of the noise that was taken off `together`, the products of the means. Rows and columns of zeros in
/// `together` stay zeros.
Eigen::MatrixXd positive_products(const Eigen::MatrixXd& unbiased, const Eigen::MatrixXd& together,
                                  const Eigen::VectorXd& scale);

}  // namespace binrig
