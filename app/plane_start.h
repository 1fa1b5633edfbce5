// Where a calibration begins: what captures of planes say at once of a model's noise, of the filters behind it and of
// its steps. A noise that is smooth and a filter that is strong look alike, and between the two lies a ridge that no
// descent by slopes crosses; a comb has a valley at every tooth. Both are seen directly in planes.
#pragma once

#include <functional>
#include <string>

#include "core/sensor_model.h"

namespace binrig {

/// Sets sigma, correlation length and white share of `spectral_noise`, strengths of the spatial effects behind it, and
/// steps of `depth_units` and `disparity_quantisation`, where the model has them, the set's train captures of planes
/// show them, and `may_move` (instance id, parameter) allows it. Nothing happens where the set has no planes.
void start_from_planes(SensorModel& model, const std::string& measured, std::uint64_t seed,
                       const std::function<bool(const std::string& id, const std::string& parameter)>& may_move);

}  // namespace binrig
