// The fit of EFFECTS.md's parametric density to a radial spectrum, and of filters behind it (calib/noise_fit.h).
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include <Eigen/Dense>
#include <opencv2/core.hpp>

#include "calib/noise_fit.h"

namespace binrig {

namespace {

// Radial means of (1-w) g + w, seen through the estimate's window. g and the window are separable, so that the
// windowed g is the product of two one-dimensional ones.
class WindowedModel {
 public:
  WindowedModel(const SpectrumEstimate& estimate, int bins)
      : n_(estimate.natural_grid()), max_lag_(estimate.max_lag_px), bins_(bins), window_(max_lag_ + 1) {
    for (int h = 0; h <= max_lag_; ++h) window_[h] = estimate.window.at<double>(max_lag_, max_lag_ + h);
  }

  // `passage`: what filters make of each frequency; empty = nothing.
  std::vector<double> radial(double length, double white, const cv::Mat& passage = {}) const {
    // Autocorrelation of g along one axis from a fine grid of frequencies, scaled to mean 1 over all frequencies.
    constexpr int fine = 512;
    std::vector<double> g(fine);
    double mean = 0;
    for (int k = 0; k < fine; ++k) {
      const double a = 2 * std::numbers::pi * length * dft_frequency(k, fine);
      g[k] = std::exp(-a * a);
      mean += g[k] / fine;
    }
    std::vector<double> axis(n_ / 2 + 1, 0.0);
    for (int h = 0; h <= max_lag_; ++h) {
      double correlation = 0;
      for (int k = 0; k < fine; ++k)
        correlation += g[k] * std::cos(2 * std::numbers::pi * ((static_cast<long long>(k) * h) % fine) / fine) / fine;
      correlation *= window_[h] / mean;
      for (int k = 0; k <= n_ / 2; ++k)
        axis[k] += (h == 0 ? 1 : 2) * correlation *
                   std::cos(2 * std::numbers::pi * ((static_cast<long long>(k) * h) % n_) / n_);
    }
    std::vector<double> sum(bins_, 0.0), count(bins_, 0.0);
    for (int row = 0; row < n_; ++row)
      for (int col = 0; col <= n_ / 2; ++col) {
        const double fy = dft_frequency(row, n_);
        const int ring = static_cast<int>(2.0 * bins_ * std::hypot(fy, static_cast<double>(col) / n_));
        if (ring >= bins_) continue;
        const double weight = col == 0 || 2 * col == n_ ? 1 : 2;
        const double passed = passage.empty() ? 1 : passage.at<double>(row, col);
        sum[ring] += weight * passed * ((1 - white) * axis[std::min(row, n_ - row)] * axis[col] + white);
        count[ring] += weight;
      }
    std::vector<double> result;
    for (int ring = 0; ring < bins_; ++ring)
      if (count[ring] > 0) result.push_back(sum[ring] / count[ring]);
    return result;
  }

 private:
  int n_, max_lag_, bins_;
  std::vector<double> window_;
};

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Rings of the density against the formula. Parameters: ln variance, ln length, white share.
class RingFit {
 public:
  RingFit(const SpectrumEstimate& estimate, double extra_relative_sd)
      // Rings no narrower than the window's width, so that their errors are nearly independent.
      : bins_(std::clamp(static_cast<int>(estimate.max_lag_px / 2.5), 4, 32)),
        data_(estimate.radial(bins_)),
        model_(estimate, bins_),
        variance_(estimate.variance_mm2()),
        extra_(extra_relative_sd) {}

  // `passage`: what filters behind the noise make of each frequency.
  ParametricNoise fit(const cv::Mat& passage = {}) {
    passage_ = passage;
    Vector3d best(std::log(variance_), 0, 0.1);
    double least = 1e300;
    for (double length : {0.3, 0.5, 0.8, 1.2, 2.0, 3.5, 6.0})
      for (double white : {0.0, 0.05, 0.2, 0.5, 0.9}) {
        Vector3d p(std::log(variance_), std::log(length), white);
        p[0] += std::log(level(p));
        const double cost = residuals(p).squaredNorm();
        if (cost < least) least = cost, best = p;
      }
    cost_ = descend(best);
    return noise(best);
  }
  double cost() const { return cost_; }
  double misfit() const { return misfit_; }

 private:
  // What the variance must be multiplied by for the rings' mean power to come out right.
  double level(const Vector3d& p) const {
    const auto shape = model_.radial(std::exp(p[1]), p[2], passage_);
    double made = 0, real = 0;
    for (std::size_t i = 0; i < shape.size(); ++i) {
      made += data_.frequency[i] * std::exp(p[0]) * shape[i];
      real += data_.frequency[i] * std::max(data_.density[i], 0.0);
    }
    return made > 0 && real > 0 ? real / made : 1;
  }
  VectorXd residuals(const Vector3d& p) const {
    const auto shape = model_.radial(std::exp(p[1]), p[2], passage_);
    VectorXd r(static_cast<Eigen::Index>(shape.size()));
    for (Eigen::Index i = 0; i < r.size(); ++i) {
      const double expected = std::exp(p[0]) * shape[i];
      r[i] = (data_.density[i] - expected) / std::max(std::hypot(data_.sd[i], extra_ * expected), 1e-9 * variance_);
    }
    return r;
  }
  // Levenberg-Marquardt with differences. Returns the cost.
  double descend(Vector3d& best) {
    const auto bounded = [](Vector3d p) {
      p[1] = std::clamp(p[1], std::log(0.05), std::log(40.0));
      p[2] = std::clamp(p[2], 0.0, 1.0);
      return p;
    };
    double damping = 1e-2, cost = residuals(best).squaredNorm();
    for (int round = 0; round < 60; ++round) {
      const VectorXd r = residuals(best);
      MatrixXd jacobian(r.size(), 3);
      for (int k = 0; k < 3; ++k) {
        Vector3d up = best, down = best;
        up[k] += 1e-3, down[k] -= 1e-3;
        jacobian.col(k) = (residuals(up) - residuals(down)) / 2e-3;
      }
      information_ = jacobian.transpose() * jacobian;
      Matrix3d damped = information_;
      damped.diagonal() *= 1 + damping;
      damped.diagonal().array() += 1e-12;
      const Vector3d next = bounded(best - damped.ldlt().solve(jacobian.transpose() * r));
      const double there = residuals(next).squaredNorm();
      if (there < cost) {
        const double gain = cost - there;
        best = next, cost = there, damping = std::max(damping / 5, 1e-9);
        if (gain < 1e-8 * cost) break;
      } else if ((damping *= 5) > 1e9) {
        break;
      }
    }
    misfit_ = cost / std::max<double>(1, static_cast<double>(data_.density.size()) - 3);
    return cost;
  }
  ParametricNoise noise(const Vector3d& best) const {
    // A density of another form than the formula makes the stated errors too small: widened by the misfit.
    const Vector3d se = (information_ + 1e-9 * Matrix3d::Identity()).inverse().diagonal().cwiseSqrt() *
                        std::sqrt(std::max(1.0, misfit_));
    ParametricNoise result;
    result.misfit = misfit_;
    result.sigma_mm = std::exp(0.5 * best[0]);
    result.correlation_length_px = std::exp(best[1]);
    result.white_share = best[2];
    result.sigma_ci95 = {result.sigma_mm * std::exp(-0.98 * se[0]), result.sigma_mm * std::exp(0.98 * se[0])};
    result.correlation_length_ci95 = {std::exp(best[1] - 1.96 * std::min(se[1], 5.0)),
                                      std::exp(best[1] + 1.96 * std::min(se[1], 5.0))};
    result.white_share_ci95 = {std::max(0.0, best[2] - 1.96 * se[2]), std::min(1.0, best[2] + 1.96 * se[2])};
    return result;
  }

  int bins_;
  RadialDensity data_;
  WindowedModel model_;
  double variance_, extra_;
  cv::Mat passage_;
  Matrix3d information_ = Matrix3d::Identity();
  double cost_ = 0, misfit_ = 0;
};

}  // namespace

ParametricNoise fit_parametric(const SpectrumEstimate& estimate, double extra_relative_sd) {
  return RingFit(estimate, extra_relative_sd).fit();
}

FilteredNoise fit_through_filters(const SpectrumEstimate& estimate, const NoiseFilters& filters,
                                  double extra_relative_sd) {
  RingFit fit(estimate, extra_relative_sd);
  FilteredNoise result;
  for (const auto& s : filters.strengths) result.strength.push_back(s.value);
  const ParametricNoise as_seen = fit.fit();
  ParametricNoise drawn = as_seen;  // what the passage is simulated with
  struct Held {
    double cost = 0;
    ParametricNoise noise;
  };
  // The noise fitted with one strength held there.
  const auto held = [&](std::size_t k, double value) {
    std::vector<double> at = result.strength;
    if (k < at.size()) at[k] = value;
    Held there;
    there.noise = fit.fit(filters.passage(drawn, at));
    there.cost = fit.cost();
    return there;
  };
  // Noise that is smooth and a filter that is strong look alike, and their valleys are two: first a wide look, then
  // ever finer ones, each with the noise of the one before (a filter may depend on how strong the noise is).
  const std::size_t count = filters.strengths.size();
  for (int round = 0; round < 3 && count > 0; ++round) {
    for (std::size_t k = 0; k < count; ++k) {
      const auto& s = filters.strengths[k];
      std::map<double, double> seen;
      const auto ask = [&](double value) {
        value = std::clamp(value, s.lower, s.upper);
        if (!seen.contains(value)) seen[value] = held(k, value).cost;
        if (seen[value] < seen[result.strength[k]]) result.strength[k] = value;
      };
      seen[result.strength[k]] = held(k, result.strength[k]).cost;
      if (round == 0)
        for (double share : {0.0, 0.5, 1.5, 2.0, 3.0}) ask(s.lower + share * (s.value - s.lower));
      double width = (s.value - s.lower) * (round == 0 ? 0.25 : round == 1 ? 0.1 : 0.03);
      for (int halved = 0; halved < (round == 0 ? 2 : 3); ++halved, width /= 2) {
        const double middle = result.strength[k];
        ask(middle - width), ask(middle + width);
      }
    }
    drawn = held(count, 0).noise;
  }
  const Held best = held(count, 0);
  result.noise = best.noise;
  const double worse = best.cost + 3.84 * std::max(1.0, best.noise.misfit);
  for (std::size_t k = 0; k < count; ++k) {
    const auto& s = filters.strengths[k];
    const double value = result.strength[k];
    // Out to where the fit is worse by chance's 95 %, either way.
    std::array<double, 2> ci95{s.lower, s.upper};
    std::array<ParametricNoise, 2> ends{best.noise, best.noise};
    bool found_above = false;
    for (int side : {0, 1}) {
      double before = 0;
      for (double reach = 0.03 * (s.value - s.lower); reach < 2 * s.scale; reach *= 2) {
        const double there = std::clamp(value + (side ? reach : -reach), s.lower, s.upper);
        const Held end = held(k, there);
        if (end.cost > worse) {
          // chi-square grows as a square from its minimum.
          const double share = std::sqrt((worse - best.cost) / (end.cost - best.cost));
          const double far = std::abs(there - value), edge = std::clamp(share * far, before, far);
          ci95[side] = value + (side ? edge : -edge);
          ends[side] = held(k, ci95[side]).noise;
          found_above |= side == 1;
          break;
        }
        before = std::abs(there - value);
        ends[side] = end.noise;
        if (there == s.lower || there == s.upper) break;
      }
    }
    result.strength_ci95.push_back(ci95);
    result.determined.push_back(found_above);
    // What the noise would be at the ends of that is in its intervals, too.
    const auto widen = [](std::array<double, 2>& interval, double value, double a, double b) {
      for (double end : {a, b}) {
        const double half = std::abs(end - value);
        interval[0] = value - std::hypot(value - interval[0], end < value ? half : 0);
        interval[1] = value + std::hypot(interval[1] - value, end > value ? half : 0);
      }
    };
    ParametricNoise& n = result.noise;
    widen(n.sigma_ci95, n.sigma_mm, ends[0].sigma_mm, ends[1].sigma_mm);
    widen(n.correlation_length_ci95, n.correlation_length_px, ends[0].correlation_length_px,
          ends[1].correlation_length_px);
    widen(n.white_share_ci95, n.white_share, ends[0].white_share, ends[1].white_share);
    n.white_share_ci95 = {std::max(0.0, n.white_share_ci95[0]), std::min(1.0, n.white_share_ci95[1])};
    n.sigma_ci95[0] = std::max(n.sigma_ci95[0], 0.0);
    n.correlation_length_ci95[0] = std::max(n.correlation_length_ci95[0], 0.0);
  }
  return result;
}

}  // namespace binrig
