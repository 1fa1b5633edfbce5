#include "compare/noise/pixel_maps.h"

#include <algorithm>
#include <cmath>

namespace binrig {

namespace {

struct LineVariances {
  double spatial = 0;   ///< variance of the lines' time means, corrected for their variance over time
  double temporal = 0;  ///< mean variance over time
  double length = 0;    ///< mean number of pixels in a line
};

LineVariances line_variances(const std::vector<double>& n, const std::vector<double>& sum,
                             const std::vector<double>& square, double pixels) {
  LineVariances out;
  double lines = 0, mean = 0, mean_square = 0, correction = 0;
  for (std::size_t i = 0; i < n.size(); ++i) {
    if (n[i] < 2) continue;
    const double m = sum[i] / n[i], v = std::max(0.0, (square[i] - n[i] * m * m) / (n[i] - 1));
    lines += 1;
    mean += m;
    mean_square += m * m;
    out.temporal += v;
    correction += v / n[i];
  }
  if (lines < 3) return out;
  out.temporal /= lines;
  out.spatial = (mean_square - mean * mean / lines) / (lines - 1) - correction / lines;
  out.length = pixels / lines;
  return out;
}

}  // namespace

PixelMaps::PixelMaps(const cv::Size& size, const cv::Mat& region)
    : region_(region),
      count_(size, CV_32F, cv::Scalar(0)),
      sum_(size, CV_64F, cv::Scalar(0)),
      square_(size, CV_64F, cv::Scalar(0)),
      row_n_(size.height, 0),
      row_sum_(row_n_),
      row_square_(row_n_),
      col_n_(size.width, 0),
      col_sum_(col_n_),
      col_square_(col_n_) {}

void PixelMaps::add(const ResidualFrame& frame) {
  ++frames_;
  std::vector<double> col_sum(col_n_.size(), 0), col_count(col_sum);
  for (int r = 0; r < count_.rows; ++r) {
    const auto* e = frame.residual_mm.ptr<float>(r);
    const auto* m = frame.valid.ptr<std::uint8_t>(r);
    double row_sum = 0, row_count = 0;
    for (int c = 0; c < count_.cols; ++c) {
      if (!m[c]) continue;
      const double x = e[c];
      count_.at<float>(r, c) += 1;
      sum_.at<double>(r, c) += x;
      square_.at<double>(r, c) += x * x;
      row_sum += x;
      row_count += 1;
      col_sum[c] += x;
      col_count[c] += 1;
    }
    // Lines with few pixels would be all noise.
    if (row_count < 16) continue;
    const double mean = row_sum / row_count;
    row_n_[r] += 1;
    row_sum_[r] += mean;
    row_square_[r] += mean * mean;
  }
  for (std::size_t c = 0; c < col_sum.size(); ++c) {
    if (col_count[c] < 16) continue;
    const double mean = col_sum[c] / col_count[c];
    col_n_[c] += 1;
    col_sum_[c] += mean;
    col_square_[c] += mean * mean;
  }
}

cv::Mat PixelMaps::known() const {
  const float least = static_cast<float>(std::max(frames_ > 1 ? 2 : 1, (frames_ + 1) / 2));
  cv::Mat out = count_ >= least;
  return out / 255;
}

cv::Mat PixelMaps::mean_mm() const {
  cv::Mat out(count_.size(), CV_32F, cv::Scalar(0));
  const cv::Mat good = known();
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) {
      if (good.at<std::uint8_t>(r, c))
        out.at<float>(r, c) = static_cast<float>(sum_.at<double>(r, c) / count_.at<float>(r, c));
    }
  }
  return out;
}

cv::Mat PixelMaps::temporal_sigma_mm() const {
  cv::Mat out(count_.size(), CV_32F, cv::Scalar(0));
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) {
      const double n = count_.at<float>(r, c);
      if (n < 2) continue;
      const double m = sum_.at<double>(r, c) / n;
      out.at<float>(r, c) =
          static_cast<float>(std::sqrt(std::max(0.0, (square_.at<double>(r, c) - n * m * m) / (n - 1))));
    }
  }
  return out;
}

cv::Mat PixelMaps::fill() const {
  cv::Mat out(count_.size(), CV_32F, cv::Scalar(0));
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) {
      if (region_.at<std::uint8_t>(r, c)) out.at<float>(r, c) = count_.at<float>(r, c) / std::max(1, frames_);
    }
  }
  return out;
}

NoiseSplit PixelMaps::split() const {
  NoiseSplit out;
  if (frames_ < 2) return out;
  double within = 0, freedom = 0, pixels = 0, mean = 0, mean_square = 0, correction = 0;
  for (int r = 0; r < count_.rows; ++r) {
    for (int c = 0; c < count_.cols; ++c) {
      const double n = count_.at<float>(r, c);
      if (n < 2) continue;
      const double m = sum_.at<double>(r, c) / n;
      within += std::max(0.0, square_.at<double>(r, c) - n * m * m);
      freedom += n - 1;
      pixels += 1;
      mean += m;
      mean_square += m * m;
      correction += 1 / n;
    }
  }
  if (pixels < 100) return out;
  const double temporal = within / freedom;
  const double spatial = (mean_square - mean * mean / pixels) / (pixels - 1) - temporal * correction / pixels;
  const auto rows = line_variances(row_n_, row_sum_, row_square_, pixels);
  const auto cols = line_variances(col_n_, col_sum_, col_square_, pixels);
  const auto root = [](double variance) { return std::sqrt(std::max(0.0, variance)); };
  out.done = true;
  out.temporal_mm = root(temporal);
  out.spatial_mm = root(spatial);
  out.temporal_row_mm = root(rows.temporal);
  out.temporal_column_mm = root(cols.temporal);
  if (rows.length > 2 && cols.length > 2) {
    const double share = 1 - 1 / rows.length - 1 / cols.length;
    const double pixel = std::max(0.0, (spatial - rows.spatial - cols.spatial) / share);
    out.pixel_mm = root(pixel);
    out.row_mm = root(rows.spatial - pixel / rows.length);
    out.column_mm = root(cols.spatial - pixel / cols.length);
  }
  return out;
}

}  // namespace binrig
