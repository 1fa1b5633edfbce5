// The captures of a recording set as a source: what a sensor model would have delivered of them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/forward_model.h"
#include "core/frame_source.h"

namespace binrig {

/// Frames of the given captures (indices into forward.captures(); empty = all), one capture after the other. They are
/// made ahead by a thread of their own, at most four at a time. Sequence numbers count on across captures.
/// An error of the simulation is thrown by next().
std::unique_ptr<FrameSource> make_forward_source(const std::string& uri, std::shared_ptr<const ForwardModel> forward,
                                                 const SensorModel& model, std::vector<int> captures,
                                                 std::uint64_t seed);

}  // namespace binrig
