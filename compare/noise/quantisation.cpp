#include "compare/noise/quantisation.h"

#include <algorithm>
#include <cmath>
#include <complex>

namespace binrig {

void ValueLevels::add(const cv::Mat& depth_mm, const cv::Mat& valid, double depth_scale_mm) {
  if (depth_scale_mm <= 0) return;
  if (counts_.empty()) {
    counts_.assign(65536, 0);
    scale_ = depth_scale_mm;
  }
  for (int r = 0; r < depth_mm.rows; ++r) {
    const auto* z = depth_mm.ptr<float>(r);
    const auto* m = valid.ptr<std::uint8_t>(r);
    for (int c = 0; c < depth_mm.cols; ++c) {
      if (!m[c]) continue;
      const double level = z[c] / scale_;
      if (level < 65535.5) ++counts_[static_cast<std::size_t>(std::lround(level))];
    }
  }
}

QuantisationStep ValueLevels::finish() const {
  QuantisationStep out;
  out.storage_step_mm = out.step_mm = scale_;
  double total = 0;
  for (const auto n : counts_) total += static_cast<double>(n);
  if (total < 100) return out;
  std::vector<double> depth;
  double sum = 0;
  for (std::size_t i = 1; i < counts_.size(); ++i) {
    sum += static_cast<double>(counts_[i]);
    // A level hit by chance (a single outlier between two steps) would hide the comb.
    if (sum > 0.01 * total && sum < 0.99 * total && counts_[i] > 0) depth.push_back(i * scale_);
  }
  out.levels = static_cast<int>(depth.size());
  if (out.levels < 8) return out;
  out.depth_mm = 0.5 * (depth.front() + depth.back());
  const double mean_gap = (depth.back() - depth.front()) / (out.levels - 1);
  if (mean_gap < 1.5 * scale_) return out;
  for (const int power : {0, 1, 2}) {
    // Depth warped so that a comb of this kind is even: the integral of (z0 / z)^power.
    std::vector<double> place;
    for (const double z : depth) {
      place.push_back(power == 0 ? z : power == 1 ? out.depth_mm * std::log(z) : -out.depth_mm * out.depth_mm / z);
    }
    const double span = place.back() - place.front();
    const double finest = 0.1 / std::max(8.0, span / mean_gap);  // a tenth of a turn over the whole span
    for (double step = 0.7 * mean_gap; step < 1.4 * mean_gap; step *= 1 + finest) {
      std::complex<double> resultant = 0;
      for (const double p : place) resultant += std::polar(1.0, 2 * CV_PI * p / step);
      const double coherence = std::abs(resultant) / out.levels;
      // The simpler comb unless the other is clearly better.
      if (coherence > out.coherence + (power > 0 ? 0.02 : 0)) {
        out.coherence = coherence;
        out.power = power;
        out.step_mm = step;
      }
    }
  }
  // Rayleigh's test; the scan looked at about as many independent steps as there are levels.
  out.p_value = std::min(1.0, 3.0 * out.levels * std::exp(-out.levels * out.coherence * out.coherence));
  out.found = out.coherence > 0.5 && out.p_value < 0.01;
  if (!out.found) {
    out.step_mm = scale_;
    out.power = 0;
  }
  return out;
}

}  // namespace binrig
