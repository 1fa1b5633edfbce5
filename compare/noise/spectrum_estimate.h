// The noise's power spectral density, estimated by Blackman and Tukey's way: the transform of the autocovariance under
// a lag window. Holes and ragged regions leave it unbiased because they leave the autocovariance unbiased; the window
// (Parzen's, in each direction) limits the resolution to about 1 / max_lag cycles/px.
#pragma once

#include <vector>

#include "compare/noise/autocovariance.h"
#include "core/spectrum.h"

namespace binrig {

/// The density (mm^2 px^2, as core/spectrum.h normalises it) on a grid of 2 max_lag x 2 max_lag frequencies. Negative
/// values, which chance makes where there is little power, become 0.
NoiseSpectrum spectral_density(const cv::Mat& covariance);

/// Mean density over rings of equal width from 0 to 0.5 cycles/px, `rings` = max_lag / 2.
struct RingSpectrum {
  std::vector<double> frequency;  ///< cycles/px, middle of the ring
  std::vector<Estimate> density;  ///< mm^2 px^2
  /// Logarithm of the density; positive densities only (others: value -inf and standard error 0).
  std::vector<Estimate> log_density;
};
RingSpectrum ring_spectrum(const Autocovariance& autocovariance);

/// Two radial spectra, ring by ring, in the logarithm.
struct SpectrumComparison {
  std::vector<double> frequency, log_ratio;  ///< ln(second / first)
  /// The 95 % pointwise prediction band of the first spectrum, given the second and what chance does to both:
  /// exp(ln second -+ t sqrt(se1^2 + se2^2)).
  std::vector<double> band_low, band_high;
  std::vector<double> p_value;    ///< each ring's, Holm-corrected over rings
  double share_inside = 0;        ///< of the rings whose first density lies in the band
  double distance_db = 0;         ///< root mean square of 10 log10(second / first)
  double worst_p = 1;             ///< smallest corrected p-value
  double degrees_of_freedom = 0;  ///< of the t tests
  int rings = 0;
};
/// Throws Error if the ring counts differ.
SpectrumComparison compare_spectra(const RingSpectrum& first, const RingSpectrum& second);

}  // namespace binrig
