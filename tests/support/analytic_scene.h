// A small scene whose every render channel is known in closed form: a plane, a box standing on it (a step) and a
// sphere. No renderer is involved, so that effects are tested on their own.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "core/channels.h"
#include "core/pose.h"
#include "sim/effect.h"

namespace binrig::test {

struct AnalyticSurface {
  double albedo = 0.5, specular = 0, shininess = 30;
};

/// Camera frame, mm. Absent parts are simply not there.
struct AnalyticScene {
  /// n . p = d with n towards the camera.
  Vector3 plane_normal = Vector3(0, 0, -1);
  double plane_offset_mm = -800;
  bool has_plane = true;
  AnalyticSurface plane_surface;
  /// Axis-parallel box.
  std::optional<std::pair<Vector3, Vector3>> box;
  AnalyticSurface box_surface;
  struct Sphere {
    Vector3 centre;
    double radius = 0;
  };
  std::optional<Sphere> sphere;
  AnalyticSurface sphere_surface;
  /// Everything moves with this velocity (mm/s); the above is the place at time 0.
  Vector3 velocity_mm_per_s = Vector3::Zero();
};

/// Plane at 800 mm, tilted a little, a box in front of its left half, a shiny sphere in front of its right half.
AnalyticScene mixed_scene();
/// A plane through (0, 0, z) turned by `tilt` about the image's vertical axis (depth grows to the right).
AnalyticScene plane_scene(double z_mm, double tilt_rad = 0, double albedo = 0.5);

/// 160 x 120, f = 200 px, centred.
Camera small_camera();

std::shared_ptr<const Channels> analytic_channels(const AnalyticScene& scene, const Camera& camera,
                                                  const std::optional<Vector3>& projector_xyz_mm,
                                                  double reference_distance_mm, double time_s = 0);

/// A capture of the scene: projector at +75 mm, z0 = 800 mm, storage in steps of 0.02 mm, 8 frames of 0.1 s, with a
/// render function that serves other views and instants of it.
CaptureContext analytic_context(const AnalyticScene& scene, const Camera& camera);

}  // namespace binrig::test
