#include "calib/plane_bias.h"

#include <cmath>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "compare/probability.h"

namespace binrig {

namespace {

double slope(const BiasTerm& term, double z) {
  switch (term.law) {
    case BiasTerm::Law::offset:
      return 1;
    case BiasTerm::Law::scale:
      return z;
    case BiasTerm::Law::disparity:
      return -z * z / term.focal_baseline;
  }
  return 0;
}

}  // namespace

std::vector<BiasValue> fit_biases(const std::vector<PlaneBias>& captures, const std::vector<BiasTerm>& terms) {
  std::vector<BiasValue> values(terms.size());
  if (terms.empty()) return values;
  const auto n = static_cast<Eigen::Index>(captures.size()), m = static_cast<Eigen::Index>(terms.size());
  if (n < m) {
    for (auto& v : values)
      v.reason = n == 0 ? "no capture of a plane has a pose of its own"
                        : fmt::format("{} capture{} with a pose for {} unknowns", n, n == 1 ? "" : "s", m);
    return values;
  }
  Eigen::MatrixXd x(n, m);
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const PlaneBias& c = captures[static_cast<std::size_t>(i)];
    for (Eigen::Index k = 0; k < m; ++k) x(i, k) = slope(terms[static_cast<std::size_t>(k)], c.distance_mm) / c.sd_mm;
    y[i] = c.bias_mm / c.sd_mm;
  }
  // Columns of very different size (1 against z): scaled before their independence is judged.
  const Eigen::VectorXd scale = x.colwise().norm().transpose().cwiseMax(1e-300);
  const Eigen::MatrixXd scaled = x * scale.cwiseInverse().asDiagonal();
  const Eigen::LDLT<Eigen::MatrixXd> normal(scaled.transpose() * scaled);
  if (normal.info() != Eigen::Success || normal.vectorD().minCoeff() < 1e-12) {
    for (auto& v : values) v.reason = "the captures are all at one distance, where these parameters do the same";
    return values;
  }
  const Eigen::VectorXd solution = normal.solve(scaled.transpose() * y);
  const Eigen::MatrixXd covariance = normal.solve(Eigen::MatrixXd::Identity(m, m));
  const double free = static_cast<double>(n - m);
  const double chi2 = free > 0 ? (y - scaled * solution).squaredNorm() / free : 1;
  const double widening = std::sqrt(std::max(1.0, chi2));
  // Where the scatter was measured it is known to `free` degrees only.
  const double t = chi2 > 1 && free > 0 ? student_threshold(0.05, free) : 1.96;
  std::vector<bool> apart_from_zero(terms.size());
  for (Eigen::Index k = 0; k < m; ++k) {
    BiasValue& v = values[static_cast<std::size_t>(k)];
    const double half = t * widening * std::sqrt(covariance(k, k)) / scale[k];
    v.value = solution[k] / scale[k];
    v.ci95 = {v.value - half, v.value + half};
    v.determined = half <= terms[static_cast<std::size_t>(k)].largest;
    if (!v.determined)
      v.reason =
          fmt::format("the interval, {:.3g} .. {:.3g}, is wider than what real sensors show", v.ci95[0], v.ci95[1]);
    apart_from_zero[static_cast<std::size_t>(k)] = std::abs(v.value) > half;
  }
  for (Eigen::Index k = 0; k < m; ++k)
    for (Eigen::Index l = 0; l < m; ++l) {
      if (l == k) continue;
      const double correlation = covariance(k, l) / std::sqrt(covariance(k, k) * covariance(l, l));
      const auto a = static_cast<std::size_t>(k), b = static_cast<std::size_t>(l);
      if (std::abs(correlation) < 0.95 || apart_from_zero[a] || apart_from_zero[b]) continue;
      values[a].determined = false;
      values[a].reason = fmt::format(
          "cannot be told from {}.{} on these distances (correlation {:.2f}); planes over a wider "
          "range of distances would",
          terms[b].instance, terms[b].parameter, correlation);
    }
  return values;
}

}  // namespace binrig
