// Whether an effect that was added is the same in every capture.
#pragma once

#include <algorithm>
#include <string>

#include "diagnose/rung.h"

namespace binrig {

/// What the model leaves of the bias, capture by capture along the derivatives of one instance's parameters: how much
/// each capture by itself wants that effect stronger, shifted or wider. An effect that is there is the same in all; one
/// that stands for something else is wanted otherwise from capture to capture, now this way, now that, so that no
/// covariate tells.
struct WantedOtherwise {
  double square = 0;     ///< of the parts of the whitened residual along the derivatives, summed over the captures
  double by_chance = 0;  ///< the same, mean over the model's own simulations
  double deviation = 0;  ///< standard deviation of those
  /// Beyond chance by six standard deviations, and by what could count for anything: where poses make up for an effect,
  /// next to nothing of it is left to scatter.
  bool significant() const { return square - by_chance > std::max(6 * deviation, 20.0); }
};

/// `rung`: with its nulls. All 0 where the effect moves no bias.
WantedOtherwise wanted_otherwise(const Layout& layout, const Rung& rung, const std::string& id);

}  // namespace binrig
