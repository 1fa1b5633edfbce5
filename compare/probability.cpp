#include "compare/probability.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/error.h"

namespace binrig {

namespace {

/// The x at which a falling function equals `target`, by bisection between 0 and a bound that is doubled until it
/// holds.
template <typename Function>
double solve_falling(const Function& f, double target, double start) {
  double low = 0, high = start;
  while (f(high) > target && high < 1e12) high *= 2;
  for (int i = 0; i < 200 && high - low > 1e-12 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (f(middle) > target ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// Continued fraction of the incomplete beta function, evaluated by Lentz's method.
double beta_fraction(double x, double a, double b) {
  constexpr double tiny = 1e-300;
  double c = 1, d = 1 - (a + b) * x / (a + 1);
  d = 1 / (std::abs(d) < tiny ? tiny : d);
  double h = d;
  for (int m = 1; m <= 500; ++m) {
    for (int half = 0; half < 2; ++half) {
      const double term = half == 0 ? m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
                                    : -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
      d = 1 + term * d;
      c = 1 + term / c;
      d = 1 / (std::abs(d) < tiny ? tiny : d);
      if (std::abs(c) < tiny) c = tiny;
      h *= d * c;
      if (half == 1 && std::abs(d * c - 1) < 1e-15) return h;
    }
  }
  return h;
}

}  // namespace

double gamma_upper(double a, double x) {
  if (x <= 0) return 1;
  const double front = std::exp(-x + a * std::log(x) - std::lgamma(a));
  if (x < a + 1) {  // series of the lower function
    double term = 1 / a, sum = term;
    for (int n = 1; n < 10000 && std::abs(term) > 1e-16 * std::abs(sum); ++n) sum += term *= x / (a + n);
    return std::clamp(1 - sum * front, 0.0, 1.0);
  }
  constexpr double tiny = 1e-300;
  double b = x + 1 - a, c = 1 / tiny, d = 1 / b, h = d;
  for (int n = 1; n < 10000; ++n) {
    const double an = -n * (n - a);
    b += 2;
    d = an * d + b;
    if (std::abs(d) < tiny) d = tiny;
    c = b + an / c;
    if (std::abs(c) < tiny) c = tiny;
    d = 1 / d;
    h *= d * c;
    if (std::abs(d * c - 1) < 1e-15) break;
  }
  return std::clamp(front * h, 0.0, 1.0);
}

double beta_lower(double x, double a, double b) {
  if (x <= 0) return 0;
  if (x >= 1) return 1;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  return x < (a + 1) / (a + b + 2) ? front * beta_fraction(x, a, b) / a : 1 - front * beta_fraction(1 - x, b, a) / b;
}

double normal_cdf(double z) { return 0.5 * std::erfc(-z / std::sqrt(2.0)); }

double normal_quantile(double p) {
  if (!(p > 0 && p < 1)) throw Error("a normal quantile needs a probability between 0 and 1, not " + number_text(p));
  if (p == 0.5) return 0;
  const double tail = std::min(p, 1 - p);
  const double z = solve_falling([](double x) { return 0.5 * std::erfc(x / std::sqrt(2.0)); }, tail, 8);
  return p < 0.5 ? -z : z;
}

double chi_square_upper(double x, double degrees_of_freedom) { return gamma_upper(degrees_of_freedom / 2, x / 2); }

double chi_square_threshold(double p, double degrees_of_freedom) {
  return solve_falling([&](double x) { return chi_square_upper(x, degrees_of_freedom); }, p,
                       2 * degrees_of_freedom + 10);
}

double student_two_sided(double t, double degrees_of_freedom) {
  return beta_lower(degrees_of_freedom / (degrees_of_freedom + t * t), degrees_of_freedom / 2, 0.5);
}

double student_threshold(double p, double degrees_of_freedom) {
  return solve_falling([&](double t) { return student_two_sided(t, degrees_of_freedom); }, p, 10);
}

std::vector<double> holm(const std::vector<double>& p_values) {
  const int n = static_cast<int>(p_values.size());
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return p_values[a] < p_values[b]; });
  std::vector<double> corrected(n);
  double running = 0;
  for (int i = 0; i < n; ++i) {
    running = std::max(running, std::min(1.0, (n - i) * p_values[order[i]]));
    corrected[order[i]] = running;
  }
  return corrected;
}

}  // namespace binrig
