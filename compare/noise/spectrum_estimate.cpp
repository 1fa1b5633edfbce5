#include "compare/noise/spectrum_estimate.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>

#include "compare/probability.h"
#include "core/error.h"

namespace binrig {

namespace {

// Parzen's lag window on -1 .. 1: its transform is nowhere negative and its side lobes fall with f^-4.
double parzen(double share) {
  const double x = std::abs(share);
  if (x >= 1) return 0;
  return x <= 0.5 ? 1 - 6 * x * x * (1 - x) : 2 * (1 - x) * (1 - x) * (1 - x);
}

}  // namespace

NoiseSpectrum spectral_density(const cv::Mat& covariance) {
  const int max_lag = covariance.rows / 2, n = 2 * max_lag;
  cv::Mat windowed(n, n, CV_32F, cv::Scalar(0));
  for (int dy = -max_lag; dy < max_lag; ++dy) {
    for (int dx = -max_lag; dx < max_lag; ++dx) {
      const double w = parzen(static_cast<double>(dy) / max_lag) * parzen(static_cast<double>(dx) / max_lag);
      windowed.at<float>((dy + n) % n, (dx + n) % n) =
          static_cast<float>(w * covariance.at<double>(dy + max_lag, dx + max_lag));
    }
  }
  const Fft2 fft(n, n);
  std::vector<std::complex<float>> transform;
  fft.forward(windowed, transform);
  cv::Mat psd(n, fft.half_cols(), CV_64F);
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < fft.half_cols(); ++c) {
      psd.at<double>(r, c) =
          std::max(0.0, static_cast<double>(transform[static_cast<std::size_t>(r) * fft.half_cols() + c].real()));
    }
  }
  return NoiseSpectrum(psd, n);
}

RingSpectrum ring_spectrum(const Autocovariance& autocovariance) {
  const int rings = std::max(4, autocovariance.max_lag() / 2);
  const double nothing = -std::numeric_limits<double>::infinity();
  RingSpectrum out;
  for (int i = 0; i < rings; ++i) out.frequency.push_back((i + 0.5) / (2 * rings));
  const auto both = autocovariance.estimate([&](const cv::Mat& covariance) {
    auto values = spectral_density(covariance).radial(rings);
    for (int i = 0; i < rings; ++i) values.push_back(values[i] > 0 ? std::log(values[i]) : -700);
    return values;
  });
  out.density.assign(both.begin(), both.begin() + rings);
  out.log_density.assign(both.begin() + rings, both.end());
  for (auto& e : out.log_density) {
    if (e.value <= -700) e = {nothing, 0, e.degrees_of_freedom};
  }
  return out;
}

SpectrumComparison compare_spectra(const RingSpectrum& first, const RingSpectrum& second) {
  if (first.frequency.size() != second.frequency.size())
    throw Error("spectra of different resolution cannot be compared");
  SpectrumComparison out;
  std::vector<double> p_values;
  std::vector<std::size_t> tested;
  int inside = 0;
  double square = 0;
  for (std::size_t i = 0; i < first.frequency.size(); ++i) {
    const Estimate &a = first.log_density[i], &b = second.log_density[i];
    if (!std::isfinite(a.value) || !std::isfinite(b.value)) continue;
    const double error = std::hypot(a.standard_error, b.standard_error);
    if (!(error > 0)) continue;
    const double dof = std::max(1.0, std::min(a.degrees_of_freedom, b.degrees_of_freedom));
    const double reach = student_threshold(0.05, dof) * error, difference = b.value - a.value;
    out.frequency.push_back(first.frequency[i]);
    out.log_ratio.push_back(difference);
    out.band_low.push_back(std::exp(b.value - reach));
    out.band_high.push_back(std::exp(b.value + reach));
    p_values.push_back(student_two_sided(difference / error, dof));
    inside += std::abs(difference) <= reach;
    square += std::pow(10 / std::log(10.0) * difference, 2);
    out.degrees_of_freedom = dof;
  }
  out.rings = static_cast<int>(p_values.size());
  if (out.rings == 0) return out;
  out.p_value = holm(p_values);
  out.worst_p = *std::min_element(out.p_value.begin(), out.p_value.end());
  out.share_inside = static_cast<double>(inside) / out.rings;
  out.distance_db = std::sqrt(square / out.rings);
  return out;
}

}  // namespace binrig
