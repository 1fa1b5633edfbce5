#include "calib/noise_spectrum.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/polynomial_basis.h"
#include "core/error.h"

namespace binrig {

namespace {

// The next size >= n without prime factors above 7, where FFTW is fast.
int fast_size(int n) {
  for (;; ++n) {
    int rest = n;
    for (int prime : {2, 3, 5, 7})
      while (rest % prime == 0) rest /= prime;
    if (rest == 1) return n;
  }
}

// Sum over images and x of image(x) image(x + h) for |h| <= max_lag, (2 M + 1)^2, by DFT with enough zeros for no lag
// to wrap.
cv::Mat autocorrelation(const std::vector<cv::Mat>& images, int max_lag) {
  const int height = images[0].rows, width = images[0].cols;
  const int rows = fast_size(height + max_lag), cols = fast_size(width + max_lag);
  cv::Mat padded = cv::Mat::zeros(rows, cols, CV_32F);
  const Fft2 fft(rows, cols);
  std::vector<std::complex<float>> spectrum, power;
  for (const cv::Mat& image : images) {
    image.copyTo(padded(cv::Rect(0, 0, width, height)));
    fft.forward(padded, spectrum);
    power.resize(spectrum.size());
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += std::norm(spectrum[k]);
  }
  fft.inverse(power, padded);
  const int side = 2 * max_lag + 1;
  cv::Mat lags(side, side, CV_64F);
  const double scale = 1.0 / (static_cast<double>(rows) * cols);
  for (int dy = -max_lag; dy <= max_lag; ++dy)
    for (int dx = -max_lag; dx <= max_lag; ++dx)
      lags.at<double>(dy + max_lag, dx + max_lag) = scale * padded.at<float>((dy + rows) % rows, (dx + cols) % cols);
  return lags;
}

// Parzen's window: no negative side lobes, which fall with the fourth power, so that a steep spectrum does not leak.
double parzen(double t) {
  t = std::abs(t);
  if (t >= 1) return 0;
  return t <= 0.5 ? 1 - 6 * t * t * (1 - t) : 2 * std::pow(1 - t, 3);
}

cv::Mat lag_window(int max_lag) {
  const int side = 2 * max_lag + 1;
  cv::Mat window(side, side, CV_64F);
  for (int row = 0; row < side; ++row)
    for (int col = 0; col < side; ++col)
      window.at<double>(row, col) =
          parzen((row - max_lag) / (max_lag + 1.0)) * parzen((col - max_lag) / (max_lag + 1.0));
  return window;
}

// Rows: the n DFT frequencies (or the half of them); columns: lags -M .. M.
void phases(int frequencies, int n, int max_lag, cv::Mat& cosines, cv::Mat& sines) {
  cosines.create(frequencies, 2 * max_lag + 1, CV_64F);
  sines.create(frequencies, 2 * max_lag + 1, CV_64F);
  for (int k = 0; k < frequencies; ++k)
    for (int h = -max_lag; h <= max_lag; ++h) {
      const double angle = 2 * std::numbers::pi * ((static_cast<long long>(k) * h) % n) / n;
      cosines.at<double>(k, h + max_lag) = std::cos(angle);
      sines.at<double>(k, h + max_lag) = std::sin(angle);
    }
}

// Sum over h of lags(h) cos(2 pi f h) at the half plane of a rows x cols DFT; lags even in h.
cv::Mat cosine_transform(const cv::Mat& lags, int rows, int cols) {
  const int max_lag = lags.rows / 2;
  cv::Mat cos_y, sin_y, cos_x, sin_x;
  phases(rows, rows, max_lag, cos_y, sin_y);
  phases(cols / 2 + 1, cols, max_lag, cos_x, sin_x);
  return cv::Mat(cos_y * lags * cos_x.t() - sin_y * lags * sin_x.t());
}

double centre(const cv::Mat& lags) { return lags.at<double>(lags.rows / 2, lags.cols / 2); }

// kappa = k / A, what the raw products are weighted with.
cv::Mat product_weights(const SpectrumEstimate& estimate) {
  cv::Mat weights = cv::Mat::zeros(estimate.window.size(), CV_64F);
  for (int row = 0; row < weights.rows; ++row)
    for (int col = 0; col < weights.cols; ++col)
      if (estimate.window.at<double>(row, col) > 0)
        weights.at<double>(row, col) = estimate.window.at<double>(row, col) / estimate.products.at<double>(row, col);
  return weights;
}

// Independent frequency cells of the masked data: the area (px) that the mask spans, all frames together. A mask with
// random holes spans more than its valid pixels: A drops at once from A(0) to A(0) times the valid share.
double spanned_area(const cv::Mat& products) {
  const int middle = products.rows / 2;
  double near = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if (dx != 0 || dy != 0) near += products.at<double>(middle + dy, middle + dx) / 8;
  return centre(products) * centre(products) / near;
}

}  // namespace

double SpectrumEstimate::variance_mm2() const { return centre(covariance); }
double SpectrumEstimate::sigma_mm() const { return std::sqrt(std::max(0.0, variance_mm2())); }

std::vector<double> SpectrumEstimate::radial_correlation() const {
  std::vector<double> sum(max_lag_px + 1, 0.0), weight(max_lag_px + 1, 0.0);
  for (int dy = -max_lag_px; dy <= max_lag_px; ++dy)
    for (int dx = -max_lag_px; dx <= max_lag_px; ++dx) {
      const int ring = static_cast<int>(std::lround(std::hypot(dx, dy)));
      const double products_here = products.at<double>(dy + max_lag_px, dx + max_lag_px);
      if (ring > max_lag_px || products_here <= 0) continue;
      sum[ring] += products_here * covariance.at<double>(dy + max_lag_px, dx + max_lag_px);
      weight[ring] += products_here;
    }
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i] = weight[i] > 0 ? sum[i] / weight[i] / variance_mm2() : 0;
  return sum;
}

double SpectrumEstimate::correlation_length_px() const {
  const auto correlation = radial_correlation();
  const double level = std::exp(-1.0);
  for (std::size_t i = 1; i < correlation.size(); ++i)
    if (correlation[i] < level) return i - 1 + (correlation[i - 1] - level) / (correlation[i - 1] - correlation[i]);
  return max_lag_px;
}

double SpectrumEstimate::effective_pixels() const {
  // Var of a mean square of Gaussian pixels = 2 sigma^4 / N^2 times the sum of rho(h)^2 A(h).
  double sum = 0;
  for (int row = 0; row < covariance.rows; ++row)
    for (int col = 0; col < covariance.cols; ++col) {
      const double rho = covariance.at<double>(row, col) / variance_mm2();
      sum += rho * rho * products.at<double>(row, col) * window.at<double>(row, col);
    }
  return centre(products) * centre(products) / sum / frame_dependence;
}

cv::Mat SpectrumEstimate::density(int rows, int cols) const {
  return cosine_transform(window.mul(covariance), rows, cols);
}

cv::Mat SpectrumEstimate::density_sd(int rows, int cols) const {
  // S = sum of kappa(h) P(h) cos(2 pi f h) weighs the masked data's periodogram, whose cells are independent with a
  // standard deviation of their mean S_Y: Var S(f) = 2 S_Y(f)^2 / X * sum of (kappa cos)^2, X the spanned area.
  const cv::Mat weights = product_weights(*this);
  const cv::Mat masked = cosine_transform(window.mul(covariance).mul(products), rows, cols);
  // Sum of kappa^2 cos^2 = (sum of kappa^2 + sum of kappa^2 cos(2 pi 2 f h)) / 2: the second part matters near the
  // frequencies that are their own mirror.
  const cv::Mat squared = weights.mul(weights);
  const double total = cv::sum(squared)[0];
  const cv::Mat doubled = cosine_transform(squared, rows, cols);
  cv::Mat result(masked.size(), CV_64F);
  const double area = spanned_area(products);
  for (int row = 0; row < rows; ++row)
    for (int col = 0; col < masked.cols; ++col) {
      const int twice_row = (2 * row) % rows, twice_col = (2 * col) % cols;
      const double at_double = twice_col < masked.cols
                                   ? doubled.at<double>(twice_row, twice_col)
                                   : doubled.at<double>((rows - twice_row) % rows, cols - twice_col);
      const double variance = frame_dependence * (total + at_double) / area;
      result.at<double>(row, col) = std::abs(masked.at<double>(row, col)) * std::sqrt(std::max(variance, 0.0));
    }
  return result;
}

RadialDensity SpectrumEstimate::radial(int bins) const {
  RadialDensity result;
  const int n = natural_grid();
  const cv::Mat s = density(n, n);
  const cv::Mat masked = cosine_transform(window.mul(covariance).mul(products), n, n);
  const cv::Mat weights = product_weights(*this);
  const double area = spanned_area(products);
  const Fft2 fft(n, n);
  std::vector<std::complex<float>> indicator;
  cv::Mat mean_cosine(n, n, CV_32F);
  for (int ring = 0; ring < bins; ++ring) {
    cv::Mat members = cv::Mat::zeros(n, n / 2 + 1, CV_64F);
    for (int row = 0; row < n; ++row)
      for (int col = 0; col <= n / 2; ++col)
        if (static_cast<int>(2.0 * bins * std::hypot(dft_frequency(row, n), static_cast<double>(col) / n)) == ring)
          members.at<double>(row, col) = col == 0 || 2 * col == n ? 1 : 2;
    const double count = cv::sum(members)[0];
    if (count == 0) continue;
    members /= count;
    // Mean of cos(2 pi f h) over the ring, for every lag: the inverse DFT of the ring's indicator.
    indicator.assign(static_cast<std::size_t>(n) * fft.half_cols(), 0.f);
    for (int row = 0; row < n; ++row)
      for (int col = 0; col <= n / 2; ++col)
        if (members.at<double>(row, col) > 0)
          indicator[static_cast<std::size_t>(row) * fft.half_cols() + col] = static_cast<float>(1 / count);
    fft.inverse(indicator, mean_cosine);
    double squares = 0;
    for (int dy = -max_lag_px; dy <= max_lag_px; ++dy)
      for (int dx = -max_lag_px; dx <= max_lag_px; ++dx)
        squares += std::pow(
            weights.at<double>(dy + max_lag_px, dx + max_lag_px) * mean_cosine.at<float>((dy + n) % n, (dx + n) % n),
            2);
    const double density_here = s.dot(members), masked_here = masked.dot(members);
    result.frequency.push_back((ring + 0.5) / (2.0 * bins));
    result.density.push_back(density_here);
    result.sd.push_back(std::abs(masked_here) * std::sqrt(2 * frame_dependence / area * squares));
  }
  return result;
}

int SpectrumEstimate::natural_grid() const { return fast_size(2 * max_lag_px + 2) / 2 * 2; }

NoiseSpectrum SpectrumEstimate::spectrum(int rows, int cols, double rounding_mm) const {
  const double white = rounding_mm * rounding_mm / 12;
  // At least a hundredth stays: a density of exactly nothing is no estimate of anything.
  const double variance = std::max(variance_mm2() - white, 0.01 * variance_mm2());
  cv::Mat s = density(rows, cols) - white;
  s = cv::max(s, 0.0);
  return NoiseSpectrum(s, cols).scaled_to(std::sqrt(variance));
}

SpectrumEstimator::SpectrumEstimator(int max_lag_px, int drop_order) : max_lag_(max_lag_px), drop_order_(drop_order) {
  if (max_lag_px < 1) throw Error(fmt::format("the largest lag must be at least 1 px, not {}", max_lag_px));
  if (drop_order < 0 || drop_order > 16)
    throw Error(fmt::format("the order of the dropped frequencies must be 0 .. 16, not {}", drop_order));
  const int side = 2 * max_lag_ + 1;
  raw_ = cv::Mat::zeros(side, side, CV_64F);
  pairs_ = cv::Mat::zeros(side, side, CV_64F);
}

void SpectrumEstimator::add(const cv::Mat& residual_mm, const cv::Mat& valid, double factor) {
  if (residual_mm.type() != CV_32F || valid.type() != CV_8U || residual_mm.size() != valid.size())
    throw Error("a residual is a float image with an 8-bit mask of its size");
  if (!cv::checkRange(residual_mm)) throw Error("a residual is not finite");
  const cv::Rect box = cv::boundingRect(valid);
  if (box.width < 2 || box.height < 2 || (box.width < 2 * max_lag_ && box.height < 2 * max_lag_))
    throw Error(
        fmt::format("a region of {} x {} pixels is too small for lags of {} px", box.width, box.height, max_lag_));
  const cv::Mat inside = valid(box).clone();
  const PolynomialBasis basis(inside, drop_order_);
  raw_ += factor * autocorrelation({basis.remainder(residual_mm(box))}, max_lag_);
  cv::Mat ones;
  inside.convertTo(ones, CV_32F, 1.0 / 255);
  cv::threshold(ones, ones, 0, 1, cv::THRESH_BINARY);
  // Counts are whole numbers; the DFT's rounding would leave 1e-4 where there are none.
  cv::Mat counts = autocorrelation({ones}, max_lag_);
  for (double& count : cv::Mat_<double>(counts)) count = std::nearbyint(count);
  pairs_ += counts;
  if (removed_.empty()) {
    // The masks of a capture differ by a few pixels: the first one's functions stand for all.
    std::vector<std::vector<cv::Mat>> functions(drop_order_ + 1);
    for (int f = 0; f < basis.size(); ++f) functions[basis.order_of(f)].push_back(basis.function(f));
    for (const auto& of_order : functions) removed_.push_back(autocorrelation(of_order, max_lag_));
  }
  ++frames_;
}

SpectrumEstimate SpectrumEstimator::finish(double frame_dependence) const {
  if (frames_ == 0) throw Error("a noise spectrum needs at least one residual");
  SpectrumEstimate estimate;
  estimate.max_lag_px = max_lag_;
  estimate.drop_order = drop_order_;
  estimate.frames = frames_;
  estimate.frame_dependence = frame_dependence;
  estimate.products = pairs_.clone();
  estimate.window = lag_window(max_lag_);
  // Lags with hardly any products would add noise and nothing else.
  const double fewest = std::max(1.0, 0.005 * centre(pairs_));
  cv::Mat inverse(pairs_.size(), CV_64F);
  for (int row = 0; row < pairs_.rows; ++row)
    for (int col = 0; col < pairs_.cols; ++col) {
      if (pairs_.at<double>(row, col) < fewest) estimate.window.at<double>(row, col) = 0;
      inverse.at<double>(row, col) = 1 / std::max(pairs_.at<double>(row, col), 1.0);
    }

  // Power b' C b in the removed orders as the remaining covariance has it, and as each order's loss lowers it; then the
  // equations for the power without loss. The lag window keeps the scatter of long lags out; its flat top is widened,
  // because it would lower the power.
  const int orders = drop_order_ + 1;
  const cv::Mat flat_top = cv::min(2 * estimate.window, 1.0);
  const auto power = [&](const cv::Mat& products, int order) {
    return flat_top.mul(inverse).mul(products).dot(removed_[order]) / (order + 1);
  };
  Eigen::MatrixXd system = Eigen::MatrixXd::Identity(orders, orders);
  Eigen::VectorXd raw(orders);
  for (int i = 0; i < orders; ++i) {
    raw[i] = power(raw_, i);
    for (int j = 0; j < orders; ++j) system(i, j) -= frames_ * power(removed_[j], i);
  }
  const Eigen::VectorXd lost = system.partialPivLu().solve(raw);
  cv::Mat whole = raw_.clone();
  for (int j = 0; j < orders; ++j) whole += frames_ * std::max(0.0, lost[j]) * removed_[j];
  estimate.covariance = whole.mul(inverse);
  return estimate;
}

int choose_max_lag(double pixels, int smaller_side_px) {
  // Relative variance of S = sum of k^2 / pixels = (0.539 M)^2 / pixels for Parzen's window in two dimensions.
  const int by_noise = static_cast<int>(0.1 * std::sqrt(pixels) / 0.539);
  return std::clamp(std::min(by_noise, smaller_side_px / 3), 8, 96);
}

cv::Mat through_window(const NoiseSpectrum& truth, const cv::Mat& window, int rows, int cols) {
  // The autocovariance of the truth at the window's lags: the inverse cosine sum over its own grid.
  const int max_lag = window.rows / 2;
  cv::Mat cos_y, sin_y, cos_x, sin_x;
  phases(truth.rows(), truth.rows(), max_lag, cos_y, sin_y);
  phases(truth.cols() / 2 + 1, truth.cols(), max_lag, cos_x, sin_x);
  cv::Mat weighted = truth.psd().clone();
  for (int col = 0; col < weighted.cols; ++col)
    if (col != 0 && 2 * col != truth.cols()) weighted.col(col) *= 2;
  weighted /= static_cast<double>(truth.rows()) * truth.cols();
  const cv::Mat covariance = cos_y.t() * weighted * cos_x - sin_y.t() * weighted * sin_x;
  return cosine_transform(window.mul(covariance), rows, cols);
}

}  // namespace binrig
