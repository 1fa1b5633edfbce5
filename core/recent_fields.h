// Random fields that were drawn lately. Simulations of one recording that differ in other parameters draw the same
// fields from the same streams, and drawing one costs more than most effects.
#pragma once

#include <cstdint>
#include <functional>

#include <opencv2/core/mat.hpp>

#include "core/random.h"

namespace binrig {

/// The field that `draw` fills from the stream `draws`, or the one that it filled lately. `kind` stands for all else that
/// the field depends on. Shared: must not be written to. From any thread. What `draw` throws passes through.
cv::Mat recent_field(std::uint64_t kind, const RandomStream& draws, const std::function<void(cv::Mat& field)>& draw);

}  // namespace binrig
