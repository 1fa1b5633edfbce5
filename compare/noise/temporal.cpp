#include "compare/noise/temporal.h"

#include <algorithm>
#include <cmath>

namespace binrig {

void TemporalNoise::add(const ResidualFrame& frame) {
  ++frames_;
  const double motion[3] = {frame.offset_mm, frame.tilt_x_mm, frame.tilt_y_mm};
  for (int i = 0; i < 3; ++i) {
    sum_[i] += motion[i];
    sum_square_[i] += motion[i] * motion[i];
  }
  // Blocks of 32 px fall into the jackknife's groups by their place, so that a place stays in one group all the time.
  constexpr int block = 32;
  const int across = (frame.residual_mm.cols + block - 1) / block;
  for (std::size_t k = 0; k < past_.size(); ++k) {
    const ResidualFrame& before = past_[k];
    double largest = 0;
    for (int r = 0; r < frame.residual_mm.rows; ++r) {
      const auto *a = frame.residual_mm.ptr<float>(r), *b = before.residual_mm.ptr<float>(r);
      const auto *ma = frame.valid.ptr<std::uint8_t>(r), *mb = before.valid.ptr<std::uint8_t>(r);
      for (int c = 0; c < frame.residual_mm.cols; ++c) {
        if (!(ma[c] & mb[c])) continue;
        const double d = a[c] - b[c];
        const std::size_t i = k * groups + (r / block * across + c / block) % groups;
        square_[i] += 0.5 * d * d;
        count_[i] += 1;
        largest = std::max(largest, std::abs(d));
      }
    }
    if (k == 0 && largest == 0 && frame.pixels > 0 && frame.offset_mm == before.offset_mm) ++repeated_;
  }
  past_.push_front(frame);
  if (past_.size() > longest_lag) past_.pop_back();
}

TemporalSummary TemporalNoise::finish() const {
  TemporalSummary out;
  out.frames = frames_;
  if (frames_ < 2) return out;
  out.repeated_share = static_cast<double>(repeated_) / (frames_ - 1);
  double* const motion[3] = {&out.offset_sigma_mm, &out.tilt_x_sigma_mm, &out.tilt_y_sigma_mm};
  for (int i = 0; i < 3; ++i) {
    *motion[i] = std::sqrt(std::max(0.0, (sum_square_[i] - sum_[i] * sum_[i] / frames_) / (frames_ - 1)));
  }
  const int lags = std::min(longest_lag, frames_ - 1);
  const auto variogram = [&](int without) {
    std::vector<double> gamma;
    for (int k = 0; k < lags; ++k) {
      double s = 0, n = 0;
      for (int g = 0; g < groups; ++g) {
        if (g == without) continue;
        s += square_[k * groups + g];
        n += count_[k * groups + g];
      }
      gamma.push_back(n > 0 ? s / n : 0);
    }
    return gamma;
  };
  const auto correlation = [&](int without) {
    const auto gamma = variogram(without);
    double later = 0;
    for (int k = 1; k < lags; ++k) later += gamma[k] / (lags - 1);
    return later > 0 ? 1 - gamma[0] / later : 0;
  };
  out.variogram_mm2 = variogram(-1);
  out.frames_independent.name = "successive frames are independent";
  out.frames_independent.method =
      "t test of the lag-1 correlation from the variogram, standard error by jackknife over places";
  if (lags < 2) {
    out.frames_independent.method = "not done: needs three frames";
    return out;
  }
  double mean = 0, square = 0, used = 0;
  std::vector<double> values;
  for (int g = 0; g < groups; ++g) {
    if (count_[g] > 0) values.push_back(correlation(g));
  }
  used = static_cast<double>(values.size());
  for (const double v : values) mean += v / used;
  for (const double v : values) square += (v - mean) * (v - mean);
  out.lag1_correlation = {correlation(-1), used > 1 ? std::sqrt((used - 1) / used * square) : 0, used - 1};
  TestResult& test = out.frames_independent;
  if (used < 3 || !(out.lag1_correlation.standard_error > 0)) return out;
  test.statistic = out.lag1_correlation.value / out.lag1_correlation.standard_error;
  test.degrees_of_freedom = used - 1;
  test.effective_n = used;
  test.threshold = student_threshold(test.level, used - 1);
  test.p_value = student_two_sided(test.statistic, used - 1);
  test.done = true;
  return out;
}

}  // namespace binrig
