// The noise spectrum of plane residuals with holes.
//
// After X. Sun, P. L. Rosin, R. R. Martin, F. C. Langbein, "Noise analysis and synthesis for 3D laser depth scanners",
// Graphical Models 71 (2009): residual of a plane, DFT, magnitude kept but for the lowest frequencies. They took the
// periodogram of one full rectangle. We deviate, because real residuals have holes and borders of any shape:
//   P(h) = sum over x of m r(x) m r(x+h)      raw products at lag h, by zero-padded DFT; m = 1 where r is valid
//   A(h) = sum over x of m(x) m(x+h)          the mask's own autocorrelation: the number of products
//   C(h) = P(h) / A(h)                        autocovariance, unbiased whatever the mask
//   S(f) = sum over h of k(h) C(h) cos(2 pi f h)   k: separable Parzen lag window, the mean over tiles of Welch
// P and A are summed over frames first. The lowest spatial frequencies are dropped by fitting a polynomial of order K
// in both coordinates (K = 1 is the plane; see low_frequencies.h for the choice); what noise loses by that fit is put
// back: E P(h) = A(h) C(h) - sum over removed functions b of (b' C b) sum over x of b(x) b(x+h), where b is taken for
// an eigenvector of the noise's covariance, which a smooth function is but at the region's border. So the density at
// the dropped frequencies is that just above them. S is in mm^2 px^2 (core/spectrum.h), on any grid: the DFT's size is
// not the region's.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/spectrum.h"

namespace binrig {

/// Mean of S over rings of width 1/(2 bins) cycles/px.
struct RadialDensity {
  std::vector<double> frequency;  ///< cycles/px, middle of the ring
  std::vector<double> density;    ///< mm^2 px^2; may be slightly negative where the truth is near 0
  std::vector<double> sd;         ///< standard deviation of the estimate; 2 (density/sd)^2 effective degrees of freedom
};

/// An estimate and everything needed to say how sure it is. Lag images are (2 M + 1) x (2 M + 1), CV_64F, lag (0, 0)
/// in the middle.
struct SpectrumEstimate {
  int max_lag_px = 0;  ///< M
  int drop_order = 1;  ///< K
  int frames = 0;
  /// Variance of a sum of this estimate's frames over that of independent ones (successive differences share
  /// frames).
  double frame_dependence = 1;
  cv::Mat covariance;  ///< C, mm^2
  cv::Mat window;      ///< k, 0 where there are too few products
  cv::Mat products;    ///< A

  double variance_mm2() const;  ///< C(0)
  double sigma_mm() const;
  /// Lag (px) at which the radially averaged autocorrelation first falls to 1/e, linear between whole lags. With
  /// white noise it is 0.63: the correlation falls from 1 to 0 within one pixel.
  double correlation_length_px() const;
  /// C(h) / C(0) averaged over lags of length 0, 1, 2, ... px.
  std::vector<double> radial_correlation() const;
  /// Independent pixels (all frames together) that have the same information about the variance.
  double effective_pixels() const;

  /// S at the DFT frequencies of rows x cols, half plane, unclipped: rows x (cols/2 + 1), CV_64F.
  cv::Mat density(int rows, int cols) const;
  /// Standard deviation of S there; the estimate has 2 (S/sd)^2 effective degrees of freedom.
  cv::Mat density_sd(int rows, int cols) const;
  RadialDensity radial(int bins) const;
  /// Clipped at 0 and scaled back to the variance. `rounding_mm`: the storage step, whose noise step^2/12 is taken
  /// out because the simulated sensor rounds, too.
  NoiseSpectrum spectrum(int rows, int cols, double rounding_mm = 0) const;
  /// A grid that carries all that the lag window lets through: rows = cols.
  int natural_grid() const;
};

/// Sum over frames. One maximal lag and drop order for all of them.
class SpectrumEstimator {
 public:
  /// Throws Error if max_lag_px < 1 or drop_order < 0 (0 = only the mean is removed) or > 16.
  SpectrumEstimator(int max_lag_px, int drop_order = 1);

  /// residual_mm: CV_32F; valid: CV_8U of the same size. `factor` multiplies the products (1/2 for a difference of
  /// two frames). Throws Error: different sizes, a residual that is not finite, fewer valid pixels than twice the
  /// removed functions, or a region narrower than two lags in both directions.
  void add(const cv::Mat& residual_mm, const cv::Mat& valid, double factor = 1);
  int frames() const { return frames_; }
  /// Throws Error if nothing was added.
  SpectrumEstimate finish(double frame_dependence = 1) const;

 private:
  int max_lag_, drop_order_, frames_ = 0;
  cv::Mat raw_, pairs_;           // sums of P and A
  std::vector<cv::Mat> removed_;  // per order: sum of the autocorrelations of the removed functions of one frame
};

/// M for regions of this many valid pixels (all frames) and smaller side: so that one frequency's relative standard
/// deviation is near 10 %, within 8 .. 96 px and a third of the side.
int choose_max_lag(double pixels, int smaller_side_px);

/// The spectrum that the window lets one see of a known one: the expectation of density(rows, cols).
cv::Mat through_window(const NoiseSpectrum& truth, const cv::Mat& window, int rows, int cols);

}  // namespace binrig
