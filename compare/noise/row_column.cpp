#include "compare/noise/row_column.h"

#include <cmath>

namespace binrig {

namespace {

double ridge(const cv::Mat& covariance, bool rows) {
  const int middle = covariance.rows / 2;
  double on = 0, off = 0;
  int on_count = 0, off_count = 0;
  for (int along = middle / 2; along <= middle; ++along) {
    for (int across = -4; across <= 4; ++across) {
      if (std::abs(across) == 1) continue;
      // Both signs of `along` hold the same pairs.
      const double c = rows ? covariance.at<double>(middle + across, middle + along)
                            : covariance.at<double>(middle + along, middle + across);
      (across == 0 ? on : off) += c;
      ++(across == 0 ? on_count : off_count);
    }
  }
  return on / on_count - off / off_count;
}

TestResult above_zero(const std::string& name, const Estimate& variance) {
  TestResult result;
  result.name = name;
  result.method = "one-sided t test of the ridge in the autocovariance, standard error by jackknife over tiles";
  if (!(variance.standard_error > 0) || variance.degrees_of_freedom < 2) return result;
  result.statistic = variance.value / variance.standard_error;
  result.degrees_of_freedom = variance.degrees_of_freedom;
  result.effective_n = variance.degrees_of_freedom + 1;
  const double two_sided = student_two_sided(result.statistic, result.degrees_of_freedom);
  result.p_value = result.statistic > 0 ? two_sided / 2 : 1 - two_sided / 2;
  result.threshold = student_threshold(2 * result.level, result.degrees_of_freedom);
  result.done = true;
  return result;
}

}  // namespace

double RowColumnNoise::row_sigma_mm() const { return std::sqrt(std::max(0.0, row_variance_mm2.value)); }
double RowColumnNoise::column_sigma_mm() const { return std::sqrt(std::max(0.0, column_variance_mm2.value)); }

RowColumnNoise row_column_noise(const Autocovariance& autocovariance) {
  const auto both = autocovariance.estimate([](const cv::Mat& covariance) {
    return std::vector<double>{ridge(covariance, true), ridge(covariance, false)};
  });
  RowColumnNoise out;
  out.row_variance_mm2 = both[0];
  out.column_variance_mm2 = both[1];
  out.no_row_noise = above_zero("rows share no noise", both[0]);
  out.no_column_noise = above_zero("columns share no noise", both[1]);
  const auto corrected = holm({out.no_row_noise.p_value, out.no_column_noise.p_value});
  out.no_row_noise.p_value = corrected[0];
  out.no_column_noise.p_value = corrected[1];
  return out;
}

}  // namespace binrig
