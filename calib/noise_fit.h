// The noise of a sensor, fitted to plane captures and judged on others.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calib/plane_noise.h"
#include "core/forward_model.h"

namespace binrig {

/// EFFECTS.md's parametric density fitted to a radial spectrum seen through the same window.
struct ParametricNoise {
  double sigma_mm = 0, correlation_length_px = 0, white_share = 0;
  std::array<double, 2> sigma_ci95{}, correlation_length_ci95{}, white_share_ci95{};
  double misfit = 0;  ///< mean square of the standardised differences; 1 = as good as chance allows
};

/// How the noise's standard deviation goes with distance and incidence over the captures:
/// sigma^2 = sigma0^2 (z/z0)^(2p) (1 + a (theta/(pi/2 - theta))^2), as axial_noise and incidence_noise of EFFECTS.md.
struct SigmaLaw {
  bool fitted = false;                     ///< false: too few captures or no spread; p = a = 0
  double reference_mm = 0;                 ///< z0
  double sigma0_mm = 0;                    ///< at z0 and theta = 0
  double exponent = 0, exponent_se = 0;    ///< p; the standard error counts the captures' scatter
  double incidence = 0, incidence_se = 0;  ///< a
  double scatter = 0;  ///< standard deviation of ln sigma about the law, chance of each estimate taken out
  /// `incidence_term`: (theta/(pi/2 - theta))^2, or its mean over a region.
  double variance_at(double distance_mm, double incidence_term) const;
};

struct FittedNoise {
  bool temporal = false;  ///< of repeats; else of single frames: an upper bound
  std::vector<std::string> captures;
  double sigma_mm = 0;  ///< at the anchor, storage rounding taken out
  std::array<double, 2> sigma_ci95{};
  double anchor_mm = 0, anchor_incidence_rad = 0,
         anchor_incidence_term = 0;  ///< where sigma holds: the captures' medians
  double rounding_mm = 0;            ///< storage step whose noise was taken out
  SpectrumEstimate shape;            ///< mean over captures of C/sigma^2 (rounding still in it)
  double between_captures = 0;       ///< standard deviation of ln S between captures at one frequency, chance taken out
  SigmaLaw law;
  /// Slope of ln(correlation length) against incidence (1/rad) over the captures, and its standard error.
  double length_slope = 0, length_slope_se = 0;
  ParametricNoise parametric;
  LowFrequencies low;
  std::vector<std::string> remarks;

  NoiseSpectrum spectrum() const;  ///< on the natural grid, sigma_mm
};

/// Throws Error if there is no capture. All captures must have been measured with one max_lag_px. `temporal`: fit the
/// noise of repeats; ignored where a capture has none.
FittedNoise fit_noise(const std::vector<CaptureNoise>& captures, const LowFrequencies& low, bool temporal);

ParametricNoise fit_parametric(const SpectrumEstimate& estimate, double extra_relative_sd = 0);

/// Effects after the noise that filter it, each with one strength.
struct NoiseFilters {
  struct Strength {
    double value = 0, lower = 0, upper = 0;
    double scale = 1;  ///< an ordinary change: an interval wider than some of these says hardly anything
  };
  std::vector<Strength> strengths;
  /// The density that comes out over the one that goes in, by the same draws, rounding taken out; on the estimate's
  /// natural grid (half plane, CV_64F).
  std::function<cv::Mat(const ParametricNoise& noise, const std::vector<double>& strengths)> passage;
};
struct FilteredNoise {
  ParametricNoise noise;  ///< before the filters
  std::vector<double> strength;
  std::vector<std::array<double, 2>> strength_ci95;  ///< down to the lower bound where it fits as well without
  std::vector<bool> determined;                      ///< false: the spectrum says hardly anything about it
};
/// The parametric density and the strengths of the filters behind it, fitted together to what came out of them all.
/// `estimate`: without rounding noise. Calls `passage` some 30 times a strength.
FilteredNoise fit_through_filters(const SpectrumEstimate& estimate, const NoiseFilters& filters,
                                  double extra_relative_sd = 0);

/// One held-out capture against what a model makes of it.
struct NoiseJudgement {
  std::string capture, name;
  bool in_sample = false;  ///< it was fitted to, so this proves nothing
  bool nearest = false;    ///< nearest to the anchor: the capture that counts
  double distance_mm = 0, incidence_rad = 0;
  double sigma_measured_mm = 0, sigma_simulated_mm = 0;
  double length_measured_px = 0, length_simulated_px = 0;
  std::vector<double> frequency, measured, simulated, band_low, band_high;  ///< radial densities, mm^2 px^2
  double share_inside = 0;             ///< of the rings, in the 95 % prediction band for a new capture
  double share_inside_estimation = 0;  ///< in the band that counts errors of estimation alone
  double band_db = 0;                  ///< mean half width of the prediction band
  double white_p = 1,
         white_statistic = 0;  ///< of the hypothesis that the measured noise is white (the Gaussian strawman)
  bool sigma_ok = false, spectrum_ok = false, length_ok = false, strawman_fails = false;
  std::vector<std::string> why;  ///< where a bound is missed, over which covariate
  bool passed() const { return sigma_ok && spectrum_ok && length_ok && strawman_fails; }
};

inline constexpr double sigma_bound = 0.10, length_bound = 0.15, inside_bound = 0.85;

/// `measured` and `simulated` went through measure_noise with the same lags and drop order.
NoiseJudgement judge_noise(const FittedNoise& fit, const CaptureNoise& measured, const CaptureNoise& simulated);

nlohmann::json noise_json(const CaptureNoise& noise);
nlohmann::json noise_json(const FittedNoise& fit);
nlohmann::json noise_json(const NoiseJudgement& judgement);

}  // namespace binrig
