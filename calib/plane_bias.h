// Systematic errors of depth from planes whose poses are known.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace binrig {

/// What one capture of a plane with a known pose says.
struct PlaneBias {
  std::string capture;
  double distance_mm = 0;  ///< mean nominal depth
  double bias_mm = 0;      ///< mean of measured minus nominal depth
  double sd_mm = 0;        ///< of that mean: mostly how well the pose is known
};

/// One effect as the direction in which it moves the capture means: bias = value * slope(z).
struct BiasTerm {
  std::string instance, parameter;
  enum class Law { offset, scale, disparity } law = Law::offset;  ///< 1, z, -z^2/(f B)
  double focal_baseline = 0;                                      ///< px mm, for disparity
  double largest = 0;  ///< a value that a real sensor may have: an interval wider than that determines nothing
};

struct BiasValue {
  double value = 0;
  std::array<double, 2> ci95{};
  bool determined = false;
  std::string reason;  ///< why not
};

/// Weighted least squares over the captures. Intervals use the stated errors, widened where the captures scatter more.
/// A term is not determined if there are fewer captures than terms, if its interval is wider than +-`largest`, or if
/// its estimate is correlated with another's by more than 0.95 and neither differs from 0 by its own interval: both are
/// then named.
std::vector<BiasValue> fit_biases(const std::vector<PlaneBias>& captures, const std::vector<BiasTerm>& terms);

}  // namespace binrig
