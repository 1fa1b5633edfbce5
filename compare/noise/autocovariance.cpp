#include "compare/noise/autocovariance.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include <fmt/format.h>

#include "core/error.h"

namespace binrig {

namespace {
constexpr double fewest_pairs = 50;
constexpr int frames_of_a_group = 16;
}  // namespace

Autocovariance::Autocovariance(int max_lag, int groups) : max_lag_(max_lag), tile_(2 * max_lag) {
  if (max_lag < 2 || groups < 2)
    throw Error(fmt::format("autocovariance needs lags and groups from 2, not {} and {}", max_lag, groups));
  const std::size_t lags = static_cast<std::size_t>(2 * max_lag + 1) * (2 * max_lag + 1);
  groups_.resize(groups);
  for (auto& g : groups_) {
    g.products.assign(lags, 0);
    g.pairs.assign(lags, 0);
  }
  group_pixels_.assign(groups, 0);
  // Tile plus the largest lag: no wrap-around within the lags that are kept. FFTW likes 2^a 3^b.
  fft_ = std::make_shared<Fft2>(3 * max_lag + (max_lag % 2), 3 * max_lag + (max_lag % 2));
}

void Autocovariance::add(const cv::Mat& residual, const cv::Mat& valid) {
  if (residual.type() != CV_32F || valid.type() != CV_8U || residual.size() != valid.size()) {
    throw Error("autocovariance needs a CV_32F residual and a CV_8U mask of one size");
  }
  const int n = fft_->rows();
  cv::Mat field(n, n, CV_32F), mask(n, n, CV_32F), product(n, n, CV_32F), pairs(n, n, CV_32F);
  std::vector<std::complex<float>> a, b;
  const double scale = 1.0 / (static_cast<double>(n) * n);
  const int tiles = ((residual.rows + tile_ - 1) / tile_) * ((residual.cols + tile_ - 1) / tile_);
  int tile = frame_++ / frames_of_a_group * tiles;
  for (int top = 0; top < residual.rows; top += tile_) {
    for (int left = 0; left < residual.cols; left += tile_, ++tile) {
      const cv::Rect place(left, top, std::min(tile_, residual.cols - left), std::min(tile_, residual.rows - top));
      field.setTo(0);
      mask.setTo(0);
      int count = 0;
      for (int r = 0; r < place.height; ++r) {
        const auto* e = residual.ptr<float>(top + r) + left;
        const auto* m = valid.ptr<std::uint8_t>(top + r) + left;
        for (int c = 0; c < place.width; ++c) {
          if (!m[c]) continue;
          field.at<float>(r, c) = e[c];
          mask.at<float>(r, c) = 1;
          ++count;
        }
      }
      if (count < std::max(64, tile_ * tile_ / 10)) continue;
      fft_->forward(field, a);
      fft_->forward(mask, b);
      for (auto& x : a) x = std::norm(x);
      for (auto& x : b) x = std::norm(x);
      fft_->inverse(a, product);
      fft_->inverse(b, pairs);
      const int group = tile % static_cast<int>(groups_.size());
      PairSums& sums = groups_[group];
      group_pixels_[group] += count;
      std::size_t i = 0;
      for (int dy = -max_lag_; dy <= max_lag_; ++dy) {
        for (int dx = -max_lag_; dx <= max_lag_; ++dx, ++i) {
          const int r = (dy + n) % n, c = (dx + n) % n;
          sums.products[i] += scale * product.at<float>(r, c);
          sums.pairs[i] += std::round(scale * pairs.at<float>(r, c));
        }
      }
    }
  }
}

int Autocovariance::groups_used() const {
  return static_cast<int>(std::count_if(group_pixels_.begin(), group_pixels_.end(), [](double n) { return n > 0; }));
}

double Autocovariance::pixels() const {
  double total = 0;
  for (const double n : group_pixels_) total += n;
  return total;
}

cv::Mat Autocovariance::covariance_of(const PairSums& sums) const {
  const int side = 2 * max_lag_ + 1;
  cv::Mat out(side, side, CV_64F);
  for (int i = 0; i < side * side; ++i) {
    out.at<double>(i / side, i % side) = sums.pairs[i] >= fewest_pairs ? sums.products[i] / sums.pairs[i] : 0;
  }
  return out;
}

namespace {

PairSums total_of(const std::vector<PairSums>& groups, int without) {
  PairSums total;
  total.products.assign(groups[0].products.size(), 0);
  total.pairs = total.products;
  for (int g = 0; g < static_cast<int>(groups.size()); ++g) {
    if (g == without) continue;
    for (std::size_t i = 0; i < total.pairs.size(); ++i) {
      total.products[i] += groups[g].products[i];
      total.pairs[i] += groups[g].pairs[i];
    }
  }
  return total;
}

}  // namespace

cv::Mat Autocovariance::covariance() const { return covariance_of(total_of(groups_, -1)); }
cv::Mat Autocovariance::covariance_without(int group) const { return covariance_of(total_of(groups_, group)); }

cv::Mat Autocovariance::pairs() const {
  PairSums total = total_of(groups_, -1);
  const int side = 2 * max_lag_ + 1;
  return cv::Mat(side, side, CV_64F, total.pairs.data()).clone();
}

std::vector<Estimate> Autocovariance::estimate(
    const std::function<std::vector<double>(const cv::Mat& covariance)>& function) const {
  const auto all = function(covariance());
  std::vector<std::vector<double>> left_out;
  for (int g = 0; g < static_cast<int>(groups_.size()); ++g) {
    if (group_pixels_[g] > 0) left_out.push_back(function(covariance_without(g)));
  }
  const double n = static_cast<double>(left_out.size());
  std::vector<Estimate> result(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    double mean = 0, square = 0;
    for (const auto& values : left_out) mean += values[i] / n;
    for (const auto& values : left_out) square += (values[i] - mean) * (values[i] - mean);
    result[i] = {all[i], n > 1 ? std::sqrt((n - 1) / n * square) : 0, n - 1};
  }
  return result;
}

int suitable_max_lag(const cv::Size& region_box) {
  return std::clamp(std::min(region_box.width, region_box.height) / 8, 8, 64) / 2 * 2;
}

}  // namespace binrig
