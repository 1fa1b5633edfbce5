#include "diagnose/how_often.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/trace.h"

namespace binrig {

double HowOften::deviation() const { return std::sqrt(scatter * value); }

std::pair<double, double> HowOften::interval(double t) const {
  const double square = t * t * scatter;
  const double middle = value + square / 2, half = std::sqrt(square * (value + square / 4));
  return {middle - half, middle + half};
}

HowOften how_often(const std::function<std::vector<double>(double value)>& found_where, double found, double start,
                   double lower, double upper) {
  constexpr int rounds = 2;  // the measure is not quite proportional
  HowOften result{start, 0};
  for (int round = 0; round < rounds && result.value > 0; ++round) {
    const std::vector<double> simulated = found_where(result.value);
    const double count = static_cast<double>(simulated.size());
    double sum = 0, square = 0;
    for (const double one : simulated) sum += one, square += one * one;
    const double mean = sum / count, variance = std::max(0.0, square - sum * mean) / (count - 1);
    if (mean <= 0) break;
    result.scatter = variance / (mean * mean) * result.value;
    result.value = std::clamp(result.value * found / mean, lower, upper);
    if (tracing())
      fmt::print(stderr, "  found {:.4g}, where it is so {:.4g}: {:.4g} +- {:.4g}\n", found, mean, result.value,
                 result.deviation());
  }
  return result;
}

}  // namespace binrig
