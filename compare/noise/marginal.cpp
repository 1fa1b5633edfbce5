#include "compare/noise/marginal.h"

#include <algorithm>
#include <cmath>

#include "compare/noise/gaussianity.h"
#include "core/error.h"

namespace binrig {

namespace {

constexpr int bins_per_sigma = 20, reach_sigma = 20, fine_bins = 2 * reach_sigma * bins_per_sigma;

// Value below which `share` of the counts lie, in bins, linear inside a bin.
double quantile_bin(const std::vector<double>& counts, double share) {
  double total = 0, sum = 0;
  for (const double c : counts) total += c;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (sum + counts[i] >= share * total && counts[i] > 0) return i + (share * total - sum) / counts[i];
    sum += counts[i];
  }
  return static_cast<double>(counts.size());
}

}  // namespace

Marginal::Marginal(double scale_mm) : scale_(scale_mm), counts_(fine_bins, 0) {
  if (!(scale_mm > 0) || !std::isfinite(scale_mm))
    throw Error("a histogram needs a positive scale, not " + number_text(scale_mm));
}

void Marginal::add(const cv::Mat& residual, const cv::Mat& valid) {
  for (int r = 0; r < residual.rows; ++r) {
    const auto* e = residual.ptr<float>(r);
    const auto* m = valid.ptr<std::uint8_t>(r);
    for (int c = 0; c < residual.cols; ++c) {
      if (!m[c]) continue;
      const double x = e[c], place = (x / scale_ + reach_sigma) * bins_per_sigma;
      counts_[static_cast<std::size_t>(std::clamp(place, 0.0, fine_bins - 1.0))] += 1;
      n_ += 1;
      s1_ += x;
      s2_ += x * x;
      s3_ += x * x * x;
      s4_ += x * x * x * x;
    }
  }
}

MarginalSummary Marginal::finish() const {
  MarginalSummary out;
  out.pixels = n_;
  if (n_ < 2) return out;
  const double m = s1_ / n_, m2 = s2_ / n_ - m * m;
  const double m3 = s3_ / n_ - 3 * m * s2_ / n_ + 2 * m * m * m;
  const double m4 = s4_ / n_ - 4 * m * s3_ / n_ + 6 * m * m * s2_ / n_ - 3 * m * m * m * m;
  out.mean_mm = m;
  out.sigma_mm = std::sqrt(std::max(0.0, m2) * n_ / (n_ - 1));
  if (m2 > 0) {
    out.skewness = m3 / std::pow(m2, 1.5);
    out.excess_kurtosis = m4 / (m2 * m2) - 3;
  }
  const double width = scale_ / bins_per_sigma;
  const double median = quantile_bin(counts_, 0.5);
  // The median absolute deviation by folding the histogram about the median.
  std::vector<double> folded(fine_bins + 1, 0);
  double beyond3 = 0, beyond4 = 0;
  for (int i = 0; i < fine_bins; ++i) {
    const double distance = std::abs(i + 0.5 - median);
    folded[static_cast<std::size_t>(std::min<double>(distance, fine_bins))] += counts_[i];
    const double value = std::abs((i + 0.5) * width - reach_sigma * scale_ - m);
    if (value > 3 * out.sigma_mm) beyond3 += counts_[i];
    if (value > 4 * out.sigma_mm) beyond4 += counts_[i];
  }
  out.robust_sigma_mm = 1.4826 * quantile_bin(folded, 0.5) * width;
  out.beyond_3_sigma = beyond3 / n_;
  out.beyond_4_sigma = beyond4 / n_;
  constexpr int shown = 6 * bins_per_sigma;
  for (int i = -shown; i <= shown; ++i) out.edges_mm.push_back(i * width);
  out.counts.assign(2 * shown, 0);
  for (int i = 0; i < fine_bins; ++i) {
    out.counts[std::clamp(i - reach_sigma * bins_per_sigma + shown, 0, 2 * shown - 1)] += counts_[i];
  }
  return out;
}

void SampleStore::add(const cv::Mat& residual, const cv::Mat& valid, int spacing) {
  if (frame_++ % stride_ != 0) return;
  frame_begin_.push_back(values_.size());
  collect(residual, valid, spacing, values_);
  if (values_.size() <= most_ || frame_begin_.size() < 2) return;
  // Every other frame goes.
  std::vector<float> kept;
  std::vector<std::size_t> begins;
  frame_begin_.push_back(values_.size());
  for (std::size_t i = 0; i + 1 < frame_begin_.size(); i += 2) {
    begins.push_back(kept.size());
    kept.insert(kept.end(), values_.begin() + static_cast<std::ptrdiff_t>(frame_begin_[i]),
                values_.begin() + static_cast<std::ptrdiff_t>(frame_begin_[i + 1]));
  }
  values_ = std::move(kept);
  frame_begin_ = std::move(begins);
  stride_ *= 2;
}

}  // namespace binrig
