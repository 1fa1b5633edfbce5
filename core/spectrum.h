// Two-dimensional spectra: the one user of FFTW.
//
// Frequencies are cycles per pixel. A power spectral density S(fx, fy) is in mm^2 px^2, normalised so that its mean over
// all N x M frequencies of a grid is the variance (mm^2) of the noise it describes; so S does not depend on the size of
// the grid that it was sampled on.
#pragma once

#include <array>
#include <complex>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/random.h"

namespace binrig {

/// Real-to-complex DFT of rows x cols images, planned once per size and shared (FFTW_ESTIMATE by default; `measured`
/// plans are kept as wisdom in the user's cache folder). Thread-safe. Unnormalised, as FFTW: inverse(forward(x)) = rows * cols * x.
class Fft2 {
 public:
  Fft2(int rows, int cols, bool measured = false);
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int half_cols() const { return cols_ / 2 + 1; }

  /// image: CV_32F rows x cols; spectrum: rows x half_cols, row-wise.
  void forward(const cv::Mat& image, std::vector<std::complex<float>>& spectrum) const;
  /// Destroys `spectrum`. An image of rows x cols is written where it is, however it lies in memory. Throws Error if the
  /// spectrum has another size.
  void inverse(std::vector<std::complex<float>>& spectrum, cv::Mat& image) const;

 private:
  struct Plans;
  int rows_, cols_;
  std::shared_ptr<const Plans> plans_;
};

/// Signed frequency (cycles/px) of DFT index k of n.
inline double dft_frequency(int k, int n) { return (k <= n / 2 ? k : k - n) / static_cast<double>(n); }

/// A bin for every frequency of the half plane of a DFT, row-wise, worked out once per size and shared. Thread-safe.
class FrequencyBins {
 public:
  /// Bin of DFT row `row` and column `col` (0 .. half_cols-1) of a rows x cols image.
  using Rule = int (*)(int row, int col, int rows, int cols);
  explicit FrequencyBins(Rule rule) : rule_(rule) {}
  /// rows x (cols/2 + 1) bins; valid as long as this object. Throws what the rule throws.
  const std::vector<int>& of(int rows, int cols);

 private:
  const Rule rule_;
  std::mutex guard_;
  std::map<std::pair<int, int>, std::vector<int>> known_;
};

/// A sampled power spectral density on the half plane of an rows x cols DFT (the other half is its mirror).
class NoiseSpectrum {
 public:
  NoiseSpectrum() = default;
  /// psd: CV_64F, rows x (cols/2 + 1), mm^2 px^2, not negative. Throws Error otherwise.
  NoiseSpectrum(cv::Mat psd, int cols);

  int rows() const { return psd_.rows; }
  int cols() const { return cols_; }
  bool empty() const { return psd_.empty(); }
  const cv::Mat& psd() const { return psd_; }
  double variance_mm2() const;
  /// S at any frequency, bilinear between samples, periodic.
  double at(double fx, double fy) const;
  /// The same density on the grid of another image size; the variance is kept exactly.
  NoiseSpectrum resampled(int rows, int cols) const;
  /// Scaled to a standard deviation (mm).
  NoiseSpectrum scaled_to(double sigma_mm) const;
  /// Mean over rings of width 1/(2 bins): `bins` values from f = 0 to 0.5; the corners beyond 0.5 are left out.
  std::vector<double> radial(int bins) const;

  /// EFFECTS.md's parametric density: (1-w) g + w with g = exp(-(2 pi L f)^2) scaled to mean 1, times sigma^2.
  static NoiseSpectrum parametric(int rows, int cols, double sigma_mm, double correlation_length_px, double white_share);

  /// A file that carries the density, what it was fitted to and the camera's size (JSON). Throws Error.
  static NoiseSpectrum read(const std::string& path);
  void write(const std::string& path, const std::string& provenance) const;
  std::string provenance;
  /// Image size (px) of the camera that it was measured on, kept in the file; 0 = unknown: fits any camera.
  int camera_width = 0, camera_height = 0;

 private:
  cv::Mat psd_;
  int cols_ = 0;
};

/// Gaussian-looking noise with a given spectrum: fixed magnitude, random phase, inverse DFT (the thesis's step 5).
/// `rayleigh` draws the magnitudes, too, which is an exact Gaussian field with scatter in every frequency.
/// The field is periodic with the size of `spectrum`'s grid.
class NoiseSynthesis {
 public:
  NoiseSynthesis(const NoiseSpectrum& spectrum, bool rayleigh = false);
  /// CV_32F, mm. With fixed magnitudes the mean is exactly 0; with drawn ones it scatters as S(0) says. The same stream
  /// gives the same bytes.
  void synthesise(const RandomStream& stream, cv::Mat& noise_mm) const;
  /// The same, kept by recent_field: must not be written to.
  cv::Mat recent(const RandomStream& stream) const;

 private:
  Fft2 fft_;
  std::uint64_t key_;  ///< of all that is below
  std::vector<float> magnitude_;
  bool rayleigh_;
};

}  // namespace binrig
