// Where in the image most is left: the place to try for an effect that has one.
#pragma once

#include <optional>

#include "diagnose/experiment.h"
#include "diagnose/metric.h"

namespace binrig {

/// A cell of the image in which maps of one kind leave more than elsewhere, in all train captures together.
struct Spot {
  double x = 0, y = 0;    ///< its centre, in halves of the image's width from the principal point
  double cell = 0;        ///< its side, in the same unit
  double stands_out = 0;  ///< its square beyond chance over what nine of ten cells do not exceed
};

/// The one that stands out most among all kinds of maps (bias, noise, drop-out); none if there is no map. `rest`: what
/// a model leaves, whitened (Layout). Squares are summed over captures: a target's edge is elsewhere in each.
std::optional<Spot> spot_left(const Experiment& experiment, const Whitened& rest);

}  // namespace binrig
