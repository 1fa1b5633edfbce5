// What is left of a depth frame when the plane it looks at is taken away.
//
// Plane n . p = d in the camera frame C, mm. The residual is z - z_plane along the optical axis, mm.
#pragma once

#include <functional>
#include <string>

#include <opencv2/core/mat.hpp>

#include "core/forward_model.h"
#include "core/frame.h"
#include "core/pose.h"

namespace binrig {

/// A flat target as one capture sees it.
struct PlaneTarget {
  Vector3 normal = Vector3(0, 0, -1);  ///< unit
  double offset_mm = -800;             ///< d
  cv::Mat region;                      ///< CV_8U, camera's size: not 0 = looks at the flat part
  bool independent = false;            ///< the plane is known from elsewhere than the depth that is judged by it
};

/// The frames of a capture, as often as asked for; the same frames every time.
using FrameStream = std::function<void(const FrameSink&)>;

/// A capture of a plane, measured or simulated.
struct PlaneCapture {
  std::string name;
  Camera camera;
  PlaneTarget target;
  FrameStream frames;
  double focal_baseline_px_mm = 0;  ///< f * B; 0 = unknown
};

/// CV_32F: depth of the plane at every pixel; 0 where the ray does not meet it in front of the camera.
cv::Mat plane_depth(const Camera& camera, const PlaneTarget& target);

struct ResidualFrame {
  cv::Mat residual_mm;  ///< CV_32F, 0 where not valid; motion removed
  cv::Mat valid;        ///< CV_8U 0/1: in the region and measured
  /// The motion of the whole plane that was removed: offset (mm) at the region's centre and the change of depth (mm)
  /// from the region's centre to its right and lower rim (half its width and height).
  double offset_mm = 0, tilt_x_mm = 0, tilt_y_mm = 0;
  int pixels = 0;  ///< valid ones
};

/// Takes the plane away from frame after frame. What is left of a rigid motion of the plane against the camera (three
/// numbers a frame: z_plane^2 (a + b x + c y), the exact first order) is fitted by least squares, twice, the second
/// time without pixels beyond five standard deviations, and removed, so that a hand-held capture's drift is not taken
/// for noise of pixels; it is returned beside the residual.
class PlaneResidual {
 public:
  /// Throws Error if the region has another size than the camera, or has less than 500 pixels.
  PlaneResidual(const Camera& camera, const PlaneTarget& target);
  ResidualFrame operator()(const Frame& frame) const;
  const cv::Mat& plane_mm() const { return plane_mm_; }
  const cv::Mat& region() const { return region_; }
  int region_pixels() const { return region_pixels_; }
  /// The smallest rectangle that holds the region.
  const cv::Rect& box() const { return box_; }
  double mean_distance_mm() const { return mean_distance_mm_; }

 private:
  cv::Mat plane_mm_, region_;
  cv::Rect box_;
  int region_pixels_ = 0;
  double mean_distance_mm_ = 0;
};

/// The smallest region (pixels) that statistics make sense on.
inline constexpr int smallest_region = 500;

}  // namespace binrig
