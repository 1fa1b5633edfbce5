// A depth camera from first principles: it projects dots, records images, matches them and triangulates. Nothing in it
// is "an effect"; quantisation, pixel locking, fattened edges, shadows and drop-outs come of themselves.
//
// Frames: C = the camera that the depth image belongs to. The matcher believes in the nominal geometry: an ideal lens,
// a second view (projector, or second camera) that differs from C by the baseline along x alone.
#pragma once

#include <array>
#include <memory>

#include "core/frame.h"
#include "core/sensor_model.h"
#include "sim/renderer.h"

namespace binrig::dot_pattern {

struct Geometry {
  Camera
      nominal;  ///< of the depth image, as the camera file says; without distortion (devices deliver rectified images)
  Camera actual;                                ///< what the lens really is; same size
  Vector3 second_view_mm = Vector3(100, 0, 0);  ///< nominal place of projector or second camera; on the x axis
  std::array<double, 2> range_mm{700, 900};     ///< which disparities are tried; depth outside is out_of_range
  double reference_distance_mm = 800;           ///< exposure 1 is meant for this distance
  double depth_scale_mm = 0;                    ///< depth is rounded to this; 0 = not
  std::uint64_t seed = 1, unit_seed = 1, capture_key = 0;
};

class Instrument {
 public:
  /// Throws Error: bad parameters (read_parameters), a distorted nominal camera, a second view off the x axis or nearer
  /// than 1 mm, a range that is not 0 < near < far or that asks for more than 2000 disparities.
  /// `renderer` must live longer.
  Instrument(const SensorModel& model, const Geometry& geometry, const Renderer& renderer);
  ~Instrument();

  /// Frames of one capture, in order. depth_mm, reason (measured, low_signal, saturated, border, out_of_range,
  /// no_match), ir (CV_16U, full scale 65535), camera and depth_scale_mm are filled; poses and times are the caller's.
  /// What the projector does not reach has no dots and is no_match or low_signal: the instrument cannot know a shadow.
  /// `since_power_on_s` is infinite for a device that is warm.
  Frame frame(const RenderScene& scene, int number, double since_power_on_s);

  /// The two images that were matched for the last frame (CV_16U, counts): the camera's, and the stored reference or
  /// the second camera's. For pictures and tests.
  cv::Mat left_image() const;
  cv::Mat right_image() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace binrig::dot_pattern
