#include "calib/noise_fit.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <opencv2/core.hpp>

#include "compare/noise/whiteness.h"
#include "compare/probability.h"
#include "core/error.h"

namespace binrig {

namespace {

double median_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n == 0 ? 0 : 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

const SpectrumEstimate& noise_of(const CaptureNoise& capture, bool temporal) {
  return temporal && capture.temporal ? *capture.temporal : capture.single;
}

double rounding_variance(const CaptureNoise& capture) { return capture.step_mm * capture.step_mm / 12; }

// Variance without the rounding's, never below a hundredth of itself.
double noise_variance(const CaptureNoise& capture, bool temporal) {
  const double all = noise_of(capture, temporal).variance_mm2();
  return std::max(all - rounding_variance(capture), 0.01 * all);
}

struct Line {
  Eigen::VectorXd coefficients, standard_errors;
  double chi_square = 0, scatter2 = 0;
};

// Weighted least squares of y on the columns of x with known variances plus a common scatter, which is found from the
// excess of chi-square over its degrees of freedom (DerSimonian and Laird's moment estimate, iterated).
Line regress(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, const Eigen::VectorXd& variance) {
  Line line;
  const Eigen::Index free = y.size() - x.cols();
  for (int round = 0; round < 20; ++round) {
    const Eigen::VectorXd weight = (variance.array() + line.scatter2).inverse();
    const Eigen::MatrixXd normal = x.transpose() * weight.asDiagonal() * x;
    const Eigen::MatrixXd inverse = normal.inverse();
    line.coefficients = inverse * (x.transpose() * (weight.asDiagonal() * y));
    line.standard_errors = inverse.diagonal().cwiseSqrt();
    const Eigen::VectorXd residual = y - x * line.coefficients;
    line.chi_square = residual.dot(weight.asDiagonal() * residual);
    if (free <= 0) break;
    const double change = (line.chi_square - static_cast<double>(free)) / weight.sum();
    const double next = std::max(0.0, line.scatter2 + change);
    if (std::abs(next - line.scatter2) < 1e-6 * (next + 1e-12)) break;
    line.scatter2 = next;
  }
  return line;
}

SigmaLaw fit_law(const std::vector<CaptureNoise>& captures, bool temporal, double reference_mm) {
  SigmaLaw law;
  law.reference_mm = reference_mm;
  const auto n = static_cast<Eigen::Index>(captures.size());
  Eigen::VectorXd log_variance(n), chance(n), log_distance(n), theta_term(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const CaptureNoise& c = captures[static_cast<std::size_t>(i)];
    log_variance[i] = std::log(noise_variance(c, temporal));
    chance[i] = 2 / std::max(1.0, noise_of(c, temporal).effective_pixels());
    log_distance[i] = std::log(c.look.plane.distance_mm / reference_mm);
    theta_term[i] = c.look.incidence_term;
  }
  const double spread = n > 0 ? log_distance.maxCoeff() - log_distance.minCoeff() : 0;
  const bool distances = n >= 3 && spread > 0.05;
  const bool tilts = n >= 5 && theta_term.maxCoeff() - theta_term.minCoeff() > 0.3;
  Line best;
  double best_a = 0;
  const auto solve = [&](double a) {
    Eigen::MatrixXd x(n, distances ? 2 : 1);
    x.col(0).setOnes();
    if (distances) x.col(1) = 2 * log_distance;
    return regress(x, log_variance - (1 + a * theta_term.array()).log().matrix(), chance);
  };
  // a is scanned: beyond it the law is linear. What is compared is the scatter about the law.
  const auto badness = [&](const Line& line) { return line.scatter2 > 0 ? line.scatter2 : -1 / (1 + line.chi_square); };
  best = solve(0);
  double low = 0, high = 0;
  if (tilts) {
    std::vector<std::pair<double, double>> scan;
    for (double a = 0; a <= 6; a += 0.02) {
      const Line line = solve(a);
      scan.emplace_back(a, badness(line));
      if (badness(line) < badness(best)) best = line, best_a = a;
    }
    // Where the scatter has grown by a factor 1 + 1/(free degrees): one standard deviation of a.
    const double limit = best.scatter2 * (1 + 1.0 / std::max<double>(1, static_cast<double>(n - 3)));
    low = high = best_a;
    for (const auto& [a, value] : scan)
      if (value <= limit) low = std::min(low, a), high = std::max(high, a);
  }
  law.fitted = distances || tilts;
  law.sigma0_mm = std::exp(0.5 * best.coefficients[0]);
  if (distances) law.exponent = best.coefficients[1], law.exponent_se = best.standard_errors[1];
  law.incidence = best_a;
  law.incidence_se = 0.5 * (high - low);
  law.scatter = 0.5 * std::sqrt(best.scatter2);
  return law;
}

int rings_for(int max_lag) { return std::clamp(static_cast<int>(max_lag / 2.5), 4, 32); }

}  // namespace

double SigmaLaw::variance_at(double distance_mm, double incidence_term) const {
  return sigma0_mm * sigma0_mm * std::pow(distance_mm / reference_mm, 2 * exponent) * (1 + incidence * incidence_term);
}

NoiseSpectrum FittedNoise::spectrum() const {
  const int n = shape.natural_grid();
  // The shape's variance is 1: the rounding's share of it is that of the captures' mean.
  const double total = sigma_mm * sigma_mm + rounding_mm * rounding_mm / 12;
  return shape.spectrum(n, n, rounding_mm / std::sqrt(total)).scaled_to(sigma_mm);
}

FittedNoise fit_noise(const std::vector<CaptureNoise>& captures, const LowFrequencies& low, bool temporal) {
  if (captures.empty()) throw Error("there is no plane capture to fit noise to");
  FittedNoise fit;
  fit.low = low;
  fit.temporal =
      temporal && std::all_of(captures.begin(), captures.end(), [](const auto& c) { return c.temporal.has_value(); });
  std::vector<double> distances, incidences, terms, steps;
  for (const auto& c : captures) {
    fit.captures.push_back(c.look.key);
    distances.push_back(c.look.plane.distance_mm);
    incidences.push_back(c.look.plane.incidence_rad);
    terms.push_back(c.look.incidence_term);
    steps.push_back(c.step_mm);
  }
  fit.anchor_mm = median_of(distances);
  fit.anchor_incidence_rad = median_of(incidences);
  fit.anchor_incidence_term = median_of(terms);
  fit.rounding_mm = median_of(steps);
  fit.law = fit_law(captures, fit.temporal, fit.anchor_mm);
  const double variance = fit.law.fitted ? fit.law.variance_at(fit.anchor_mm, fit.anchor_incidence_term)
                                         : fit.law.sigma0_mm * fit.law.sigma0_mm;
  fit.sigma_mm = std::sqrt(variance);

  // Mean shape: every capture's covariance over its variance, weighted by its products.
  SpectrumEstimate& shape = fit.shape;
  double effective = 0;
  for (const auto& c : captures) {
    const SpectrumEstimate& one = noise_of(c, fit.temporal);
    const cv::Mat weighted = one.covariance.mul(one.products) / one.variance_mm2();
    if (shape.covariance.empty()) {
      shape = one;
      shape.covariance = weighted;
      shape.products = one.products.clone();
      shape.window = one.window.clone();
    } else {
      if (one.max_lag_px != shape.max_lag_px) throw Error("captures were measured with different lags");
      shape.covariance += weighted;
      shape.products += one.products;
      shape.window = cv::min(shape.window, one.window);
      shape.frames += one.frames;
      shape.frame_dependence = std::max(shape.frame_dependence, one.frame_dependence);
    }
    effective += one.effective_pixels();
  }
  cv::divide(shape.covariance, cv::max(shape.products, 1.0), shape.covariance);

  // Scatter of ln S between captures, beyond what estimation explains, over all rings.
  const int bins = rings_for(shape.max_lag_px);
  const RadialDensity mean = shape.radial(bins);
  double excess = 0;
  int rings = 0;
  for (const auto& c : captures) {
    const SpectrumEstimate& one = noise_of(c, fit.temporal);
    const RadialDensity radial = one.radial(bins);
    const double level =
        (fit.law.fitted ? fit.law.variance_at(c.look.plane.distance_mm, c.look.incidence_term) : variance) +
        rounding_variance(c);
    for (std::size_t r = 0; r < radial.density.size(); ++r) {
      if (radial.density[r] <= 0 || mean.density[r] <= 0) continue;
      const double difference = std::log(radial.density[r] / (mean.density[r] * level));
      excess += difference * difference - std::pow(radial.sd[r] / radial.density[r], 2);
      ++rings;
    }
  }
  const double captures_free = static_cast<double>(captures.size()) - 1;
  if (captures_free > 0 && rings > 0)
    fit.between_captures = std::sqrt(std::max(0.0, excess / rings * (captures_free + 1) / captures_free));

  const double relative = std::sqrt(0.5 / std::max(1.0, effective) +
                                    (captures_free > 0 ? std::pow(fit.law.scatter, 2) / (captures_free + 1) : 0));
  const double t = captures_free > 0 && fit.law.scatter > 0 ? student_threshold(0.05, captures_free) : 1.96;
  fit.sigma_ci95 = {fit.sigma_mm * std::exp(-t * relative), fit.sigma_mm * std::exp(t * relative)};
  fit.parametric = fit_parametric(shape, fit.between_captures / std::sqrt(std::max(1.0, captures_free + 1)));
  fit.parametric.sigma_mm = fit.sigma_mm;
  fit.parametric.sigma_ci95 = fit.sigma_ci95;

  if (captures.size() >= 4) {
    Eigen::MatrixXd x(static_cast<Eigen::Index>(captures.size()), 2);
    Eigen::VectorXd y(x.rows()), chance(x.rows());
    for (Eigen::Index i = 0; i < x.rows(); ++i) {
      const CaptureNoise& c = captures[static_cast<std::size_t>(i)];
      x.row(i) << 1, c.look.plane.incidence_rad;
      y[i] = std::log(std::max(0.1, noise_of(c, fit.temporal).correlation_length_px()));
      chance[i] = 1e-4;
    }
    if (x.col(1).maxCoeff() - x.col(1).minCoeff() > 0.2) {
      const Line line = regress(x, y, chance);
      fit.length_slope = line.coefficients[1];
      fit.length_slope_se = line.standard_errors[1];
    }
  }
  if (std::abs(fit.length_slope) > 2.5 * fit.length_slope_se && std::abs(fit.length_slope) > 0.3)
    fit.remarks.push_back(fmt::format(
        "the spectrum's shape goes with incidence: the correlation length changes by {:+.0f} % over 30 deg of "
        "tilt, which one spectrum cannot follow",
        100 * (std::exp(fit.length_slope * std::numbers::pi / 6) - 1)));
  if (!fit.temporal)
    fit.remarks.push_back(
        "not every train capture has repeats: the spectrum is that of single frames, an upper bound for "
        "the noise (fixed pattern and shape are in it)");
  if (!low.plateau_found) fit.remarks.push_back("low frequencies: " + low.reason);
  if (fit.law.fitted && std::abs(fit.law.exponent) > 2 * fit.law.exponent_se && std::abs(fit.law.exponent) > 0.2)
    fit.remarks.push_back(
        fmt::format("the noise goes with distance to the power {:.2f} +- {:.2f}: one sigma holds at {:.0f} "
                    "mm only; add axial_noise to the model",
                    fit.law.exponent, fit.law.exponent_se, fit.anchor_mm));
  if (fit.law.incidence > 2 * fit.law.incidence_se && fit.law.incidence > 0.05)
    fit.remarks.push_back(
        fmt::format("the noise grows with incidence, a = {:.2f} +- {:.2f}; add incidence_noise to the model",
                    fit.law.incidence, fit.law.incidence_se));
  return fit;
}

NoiseJudgement judge_noise(const FittedNoise& fit, const CaptureNoise& measured, const CaptureNoise& simulated) {
  NoiseJudgement j;
  j.capture = measured.look.key;
  j.name = measured.look.name;
  j.in_sample = std::find(fit.captures.begin(), fit.captures.end(), j.capture) != fit.captures.end();
  j.distance_mm = measured.look.plane.distance_mm;
  j.incidence_rad = measured.look.plane.incidence_rad;
  const bool temporal = fit.temporal && measured.temporal && simulated.temporal;
  const SpectrumEstimate& real = noise_of(measured, temporal);
  const SpectrumEstimate& made = noise_of(simulated, temporal);
  j.sigma_measured_mm = real.sigma_mm();
  j.sigma_simulated_mm = made.sigma_mm();
  j.length_measured_px = real.correlation_length_px();
  j.length_simulated_px = made.correlation_length_px();

  const int bins = rings_for(real.max_lag_px);
  const RadialDensity a = real.radial(bins), b = made.radial(bins), f = fit.shape.radial(bins);
  const double free = std::max<double>(1, static_cast<double>(fit.captures.size()) - 1);
  const double t = fit.between_captures > 0 ? student_threshold(0.05, free) : 1.96;
  int inside = 0, inside_estimation = 0;
  for (std::size_t r = 0; r < a.density.size(); ++r) {
    const double centre = std::max(b.density[r], 1e-12);
    const auto relative2 = [&](const RadialDensity& d) { return std::pow(d.sd[r] / std::max(d.density[r], 1e-12), 2); };
    const double estimation = relative2(a) + relative2(b) + relative2(f);
    const double all = std::sqrt(estimation + std::pow(fit.between_captures, 2));
    j.frequency.push_back(a.frequency[r]);
    j.measured.push_back(a.density[r]);
    j.simulated.push_back(b.density[r]);
    j.band_low.push_back(centre * std::exp(-t * all));
    j.band_high.push_back(centre * std::exp(t * all));
    const double difference = std::abs(std::log(std::max(a.density[r], 1e-12) / centre));
    inside += difference <= t * all;
    inside_estimation += difference <= 1.96 * std::sqrt(estimation);
    j.band_db += 10 / std::numbers::ln10 * t * all / static_cast<double>(a.density.size());
  }
  j.share_inside = static_cast<double>(inside) / static_cast<double>(a.density.size());
  j.share_inside_estimation = static_cast<double>(inside_estimation) / static_cast<double>(a.density.size());
  const TestResult white = whiteness(real.covariance, real.products);
  j.white_p = white.p_value;
  j.white_statistic = white.statistic;

  j.sigma_ok = std::abs(j.sigma_simulated_mm / j.sigma_measured_mm - 1) <= sigma_bound;
  j.length_ok = std::abs(j.length_simulated_px / j.length_measured_px - 1) <= length_bound;
  j.spectrum_ok = j.share_inside >= inside_bound;
  j.strawman_fails = j.white_p < 0.05;
  // Why a bound is missed: what the train captures say about distance and incidence, what the model's other effects do
  // here, what the noise does within the image.
  const double by_law = fit.law.fitted ? fit.law.variance_at(j.distance_mm, measured.look.incidence_term) /
                                             fit.law.variance_at(fit.anchor_mm, fit.anchor_incidence_term)
                                       : 1;
  if (fit.temporal && !temporal)
    j.why.push_back(
        "this capture is a single frame: its fixed pattern and shape cannot be taken out, while the fitted noise is "
        "what changes between frames (--noise frame fits single frames)");
  if (!j.sigma_ok) {
    const double needed = std::log(std::pow(j.sigma_measured_mm / j.sigma_simulated_mm, 2));
    const double explained = std::log(by_law) / needed;
    if (explained > 0.5 && explained < 2)
      j.why.push_back(
          fmt::format("sigma: the noise goes with distance (power {:.1f}) and incidence (a = {:.1f}) over the "
                      "train captures, which accounts for {:.0f} % of the difference; a model with axial_noise "
                      "and incidence_noise can follow that",
                      fit.law.exponent, fit.law.incidence, 100 * explained));
    else
      j.why.push_back(
          fmt::format("sigma: off by {:+.0f} %, which distance and incidence of the train captures do not explain "
                      "(captures scatter by {:.0f} % about that law)",
                      100 * (j.sigma_simulated_mm / j.sigma_measured_mm - 1), 100 * fit.law.scatter));
  }
  const double fitted = std::hypot(fit.sigma_mm, fit.rounding_mm / std::sqrt(12.0));
  if (!j.passed() && std::abs(j.sigma_simulated_mm / fitted - 1) > 0.03)
    j.why.push_back(fmt::format(
        "the simulated noise is {:+.0f} % against that at the fit's anchor: other effects of the model depend on "
        "distance or incidence (a bilateral blur, for one, passes more noise on a slope)",
        100 * (j.sigma_simulated_mm / fitted - 1)));
  if (!j.spectrum_ok || !j.length_ok) {
    // Which end of the spectrum misses the band says what kind of trouble it is.
    const std::size_t n = j.frequency.size(), cut = std::max<std::size_t>(1, n / 3);
    double low_end = 0, high_end = 0;
    for (std::size_t r = 0; r < n; ++r)
      (r < cut ? low_end : high_end) += std::log(std::max(j.measured[r], 1e-12) / std::max(j.simulated[r], 1e-12)) /
                                        static_cast<double>(r < cut ? cut : n - cut);
    const double db = 10 / std::numbers::ln10;
    j.why.push_back(
        fmt::format("spectrum: measured over simulated is {:+.1f} dB below {:.2f} cycles/px and {:+.1f} dB above",
                    db * low_end, j.frequency[cut], db * high_end));
    const double rounding = rounding_variance(measured);
    if (!j.measured.empty() && j.measured.back() < rounding)
      j.why.push_back(
          "spectrum: at its high end the density is below that of the storage step's own rounding: the values were "
          "filtered or resampled after they had been rounded, and a simulated rounding cannot fall below it");
  }
  if (!j.length_ok && std::abs(fit.length_slope) > 2.5 * fit.length_slope_se) {
    j.why.push_back(
        fmt::format("correlation length: over the train captures it changes by {:+.0f} % per 10 deg of incidence; "
                    "this one differs from the fit's by {:+.0f} deg",
                    100 * (std::exp(fit.length_slope * std::numbers::pi / 18) - 1),
                    (j.incidence_rad - fit.anchor_incidence_rad) * 180 / std::numbers::pi));
  }
  if (!j.passed()) {
    const Stationarity& s = measured.stationarity;
    if (s.scatter > 0.05)
      j.why.push_back(fmt::format(
          "within the image the measured noise is not equally strong: sigma of {} px cells scatters by "
          "{:.0f} %{}",
          s.cell_px, 100 * s.scatter,
          s.covariate.empty() ? "" : fmt::format(", {:.0f} % of it with {}", 100 * s.explained, s.covariate)));
  }
  return j;
}

}  // namespace binrig
