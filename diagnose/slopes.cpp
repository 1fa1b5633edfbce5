#include "diagnose/slopes.h"

#include <algorithm>

#include <Eigen/Eigenvalues>

#include "core/parallel.h"

namespace binrig {

using Eigen::MatrixXd;

SeedMean mean_over_seeds(const Layout& layout, const std::vector<Whitened>& by_seed) {
  const int k = static_cast<int>(by_seed.size());
  SeedMean result{Whitened(layout.size, 0.f), std::vector<double>(segments().size(), 0)};
  std::vector<double> square(segments().size(), 0), noise(segments().size(), 0);
  for (const auto& block : layout.blocks)
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      float& mean = result.mean[i];
      for (const Whitened& one : by_seed) mean += one[i] / k;
      square[block.segment] += static_cast<double>(mean) * mean;
      for (const Whitened& one : by_seed)
        noise[block.segment] += static_cast<double>(one[i] - mean) * (one[i] - mean) / std::max(1.0, k * (k - 1.0));
    }
  for (std::size_t s = 0; s < square.size(); ++s)
    if (square[s] > 0) result.signal[s] = 1 - noise[s] / square[s];
  return result;
}

Whitened shrunk(const Layout& layout, const SeedMean& mean, double least) {
  Whitened result = mean.mean;
  for (const auto& block : layout.blocks) {
    const double share = mean.signal[block.segment];
    const float f = share < least ? 0.f : static_cast<float>(share);
    for (int i = block.offset; i < block.offset + block.size; ++i) result[i] *= f;
  }
  return result;
}

void pool(const Layout& layout, const std::vector<float>& spread, const std::vector<bool>& segments, Whitened& change) {
  for (const Block& block : layout.blocks) {
    if (block.rows == 1 || !segments[block.segment]) continue;
    double sum = 0;
    int known = 0;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (spread[i] > 0) sum += change[i], ++known;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (spread[i] > 0) change[i] = static_cast<float>(sum / known);
  }
}

std::vector<bool> pool_noisy(const Layout& layout, const std::vector<float>& spread, double least,
                             std::vector<Whitened>& by_seed) {
  std::vector<bool> noisy;
  for (const double signal : mean_over_seeds(layout, by_seed).signal) noisy.push_back(signal < least);
  std::vector<Whitened> pooled = by_seed;
  for (Whitened& one : pooled) pool(layout, spread, noisy, one);
  const SeedMean mean = mean_over_seeds(layout, pooled);
  for (std::size_t s = 0; s < noisy.size(); ++s) noisy[s] = noisy[s] && mean.signal[s] >= least;
  for (Whitened& one : by_seed) pool(layout, spread, noisy, one);
  return noisy;
}

Pull::Pull(const Whitened& rest) : direct_(rest), bent_(rest.size()), lost_(rest.size()) {
  uncompress(direct_);
  for (std::size_t i = 0; i < rest.size(); ++i) {
    const float slope = compression_slope(rest[i]);
    bent_[i] = slope * rest[i] - direct_[i];
    lost_[i] = 1 - slope * slope;
  }
}

Whitened Pull::curved(const Whitened& slope, const Whitened& freed) const {
  Whitened result = slope;
  for (std::size_t i = 0; i < result.size(); ++i) result[i] -= lost_[i] * freed[i];
  return result;
}

namespace {

/// Sums over seeds k, l of left . right, of all or of different ones, divided by their number.
MatrixXd products(const SeedSlopes& left, const SeedSlopes& right, bool same_seed) {
  const int n = static_cast<int>(left.size());
  int seeds = 1;
  for (const auto& of : left) seeds = std::max(seeds, static_cast<int>(of.size()));
  MatrixXd result = MatrixXd::Zero(n, n);
  parallel_for(n, [&](int p) {
    for (int q = 0; q < n; ++q)
      for (std::size_t k = 0; k < left[p].size(); ++k)
        for (std::size_t l = 0; l < right[q].size(); ++l)
          if (same_seed || k != l) result(p, q) += dot(left[p][k], right[q][l]);
  });
  return (result + result.transpose()) / (2.0 * seeds * (same_seed ? seeds : std::max(1, seeds - 1)));
}

}  // namespace

MatrixXd products_of_means(const SeedSlopes& left, const SeedSlopes& right) { return products(left, right, true); }

MatrixXd unbiased_products(const SeedSlopes& left, const SeedSlopes& right) { return products(left, right, false); }

MatrixXd positive_products(const MatrixXd& unbiased, const MatrixXd& together, const Eigen::VectorXd& scale) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> directions(scale.asDiagonal() * unbiased * scale.asDiagonal());
  const MatrixXd axes = scale.cwiseInverse().asDiagonal() * directions.eigenvectors();
  const MatrixXd ends = scale.asDiagonal() * directions.eigenvectors();
  Eigen::VectorXd squares = directions.eigenvalues();
  for (int d = 0; d < squares.size(); ++d) {
    const double noise = std::max(0.0, ends.col(d).dot((together - unbiased) * ends.col(d)));
    squares[d] = std::max(squares[d], 0.05 * noise);
  }
  MatrixXd result = axes * squares.asDiagonal() * axes.transpose();
  for (int p = 0; p < squares.size(); ++p)
    if (together(p, p) == 0) result.row(p).setZero(), result.col(p).setZero();
  return result;
}

}  // namespace binrig
