// The distributions that tests are judged by, and what a test returns.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace binrig {

/// What a test of a hypothesis found; never a bare yes or no.
struct TestResult {
  std::string name;  ///< of the hypothesis: "is Gaussian"
  double statistic = 0;
  double threshold = 0;  ///< the statistic beyond which the hypothesis is rejected at `level`
  double p_value = 1;
  double degrees_of_freedom = 0;
  double effective_n = 0;  ///< independent samples that the data are worth
  double level = 0.05;
  cv::Mat map;  ///< the evidence (CV_32F), or empty
  std::string map_meaning;
  std::string method;  ///< in one sentence
  bool done = false;   ///< false: too few data, see `method`; the hypothesis then stands
  bool rejected() const { return done && p_value < level; }
};

/// Regularised upper incomplete gamma function Q(a, x), a > 0, x >= 0.
double gamma_upper(double a, double x);
/// Regularised incomplete beta function I_x(a, b).
double beta_lower(double x, double a, double b);

double normal_cdf(double z);
/// Throws Error unless 0 < p < 1.
double normal_quantile(double p);
/// P(X > x) of a chi-square variable.
double chi_square_upper(double x, double degrees_of_freedom);
/// x with P(X > x) = p.
double chi_square_threshold(double p, double degrees_of_freedom);
/// P(|T| > |t|) of Student's t.
double student_two_sided(double t, double degrees_of_freedom);
/// |t| with P(|T| > |t|) = p.
double student_threshold(double p, double degrees_of_freedom);

/// Holm's step-down correction: p-values such that rejecting all below `level` keeps the chance of any false rejection
/// at `level` (S. Holm, "A simple sequentially rejective multiple test procedure", 1979).
std::vector<double> holm(const std::vector<double>& p_values);

}  // namespace binrig
