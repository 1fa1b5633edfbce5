// Frames that a sensor model makes of a plane that was fitted to a capture.
#pragma once

#include <cstdint>

#include "calib/plane_noise.h"
#include "core/sensor_model.h"

namespace binrig {

struct PlaneSimulation {
  Camera camera;
  Vector3 normal = Vector3(0, 0, -1);
  double offset_mm = -800;
  std::optional<Vector3> projector_xyz_mm;  ///< of the recording; the model's own counts first
  double reference_distance_mm = 0;         ///< z0 where the model says `recording`
  double depth_scale_mm = 0;                ///< of the recording, where the model says `recording`
  int frames = 1;
  std::uint64_t seed = 1;
  std::string capture;  ///< keys the draws
};

/// Frames 0 .. frames-1, each rendered by the analytic plane renderer. With frames = 1 and `repeats` > 1, so many
/// independent recordings of one frame are made. The model must outlive the stream.
FrameStream simulate_plane(const SensorModel& model, const PlaneSimulation& simulation, int repeats = 1);

}  // namespace binrig
