// The fit of EFFECTS.md's parametric density to a radial spectrum (fit_parametric of calib/noise_fit.h).
#include <algorithm>
#include <cmath>
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

  std::vector<double> radial(double length, double white) const {
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
        sum[ring] += weight * ((1 - white) * axis[std::min(row, n_ - row)] * axis[col] + white);
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

}  // namespace

ParametricNoise fit_parametric(const SpectrumEstimate& estimate, double extra_relative_sd) {
  // Rings no narrower than the window's width, so that their errors are nearly independent.
  const int bins = std::clamp(static_cast<int>(estimate.max_lag_px / 2.5), 4, 32);
  const RadialDensity data = estimate.radial(bins);
  const WindowedModel model(estimate, bins);
  const auto n = static_cast<Eigen::Index>(data.density.size());
  // Parameters: ln variance, ln length, white share.
  const auto residuals = [&](const Eigen::Vector3d& p) {
    const auto shape = model.radial(std::exp(p[1]), p[2]);
    Eigen::VectorXd r(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double expected = std::exp(p[0]) * shape[i];
      const double sd = std::hypot(data.sd[i], extra_relative_sd * expected);
      r[i] = (data.density[i] - expected) / std::max(sd, 1e-9 * estimate.variance_mm2());
    }
    return r;
  };
  const auto bounded = [](Eigen::Vector3d p) {
    p[1] = std::clamp(p[1], std::log(0.05), std::log(40.0));
    p[2] = std::clamp(p[2], 0.0, 1.0);
    return p;
  };
  Eigen::Vector3d best(std::log(estimate.variance_mm2()), 0, 0.1);
  double best_cost = 1e300;
  for (double length : {0.3, 0.5, 0.8, 1.2, 2.0, 3.5, 6.0})
    for (double white : {0.0, 0.05, 0.2, 0.5}) {
      const Eigen::Vector3d start(std::log(estimate.variance_mm2()), std::log(length), white);
      const double cost = residuals(start).squaredNorm();
      if (cost < best_cost) best_cost = cost, best = start;
    }
  // Levenberg-Marquardt with differences.
  double damping = 1e-2;
  Eigen::Matrix3d information = Eigen::Matrix3d::Identity();
  for (int round = 0; round < 60; ++round) {
    const Eigen::VectorXd r = residuals(best);
    Eigen::MatrixXd jacobian(n, 3);
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3d up = best, down = best;
      up[k] += 1e-3, down[k] -= 1e-3;
      jacobian.col(k) = (residuals(up) - residuals(down)) / 2e-3;
    }
    information = jacobian.transpose() * jacobian;
    Eigen::Matrix3d damped = information;
    damped.diagonal() *= 1 + damping;
    damped.diagonal().array() += 1e-12;
    const Eigen::Vector3d next = bounded(best - damped.ldlt().solve(jacobian.transpose() * r));
    const double cost = residuals(next).squaredNorm();
    if (cost < best_cost) {
      const double gain = best_cost - cost;
      best = next, best_cost = cost, damping = std::max(damping / 5, 1e-9);
      if (gain < 1e-8 * best_cost) break;
    } else if ((damping *= 5) > 1e9) {
      break;
    }
  }
  ParametricNoise result;
  result.misfit = best_cost / std::max<double>(1, static_cast<double>(n) - 3);
  // A density of another form than the formula makes the stated errors too small: widened by the misfit.
  const Eigen::Vector3d se = (information + 1e-9 * Eigen::Matrix3d::Identity()).inverse().diagonal().cwiseSqrt() *
                             std::sqrt(std::max(1.0, result.misfit));
  result.sigma_mm = std::exp(0.5 * best[0]);
  result.correlation_length_px = std::exp(best[1]);
  result.white_share = best[2];
  result.sigma_ci95 = {result.sigma_mm * std::exp(-0.98 * se[0]), result.sigma_mm * std::exp(0.98 * se[0])};
  result.correlation_length_ci95 = {std::exp(best[1] - 1.96 * std::min(se[1], 5.0)),
                                    std::exp(best[1] + 1.96 * std::min(se[1], 5.0))};
  result.white_share_ci95 = {std::max(0.0, best[2] - 1.96 * se[2]), std::min(1.0, best[2] + 1.96 * se[2])};
  return result;
}

}  // namespace binrig
