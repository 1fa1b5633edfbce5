// How often something happens to whole frames. Nothing that compares a few simulations with the recording says it: it
// happens in others of their frames.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "diagnose/rung.h"

namespace binrig {

struct HowOften {
  double value = 0;
  /// Variance of what is found, over the value: what is counted scatters by the root of how often it happens. 0:
  /// nothing was found where it does happen, and the value is the one begun with.
  double scatter = 0;
  double deviation() const;  ///< of the value
  /// Values that `t` of their own deviations reach from to this one (Wilson, Probable inference, the law of succession,
  /// and statistical inference, J. Am. Stat. Assoc. 22, 209 (1927), for rare events). `t`: of the confidence wanted.
  std::pair<double, double> interval(double t) const;
};

/// `found_where`: what some measure of it, proportional to how often it happens but for a factor, finds in some (at
/// least 2) simulated recordings in which it does so by the given value; `found`: in the recording. Begins at `start`
/// (more than 0) and stays within the bounds. Throws what `found_where` throws.
HowOften how_often(const std::function<std::vector<double>(double value)>& found_where, double found, double start,
                   double lower, double upper);

inline constexpr int counted_recordings = 24;  ///< simulated for each value

/// How often what parameter `spec` of instance `id` (its chance to happen to a whole frame) stands for happened in the
/// train captures, by what distinguishes recordings of `model` in which it does from others. `row`: the parameter's
/// among the nuisances of the rung, which then may not stand in for it. Throws what simulating throws.
HowOften count_occurrences(const Experiment& experiment, const Rung& rung, const SensorModel& model,
                           const std::string& id, const ParameterSpec& spec, int row, std::uint64_t seed);

}  // namespace binrig
