// What a depth camera says at one instant, real or simulated.
//
// Depth is Z in the camera frame, in millimetres, with pixel centres at integer coordinates. An image never contains
// NaN: an invalid pixel has depth 0 and a reason. Drivers convert to this at their border, once.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/camera.h"
#include "core/pose.h"

namespace binrig {

/// Why a pixel has no depth; `measured` means that it has. The numbers are those of reason/*.png.
enum class Reason : std::uint8_t {
  measured = 0,
  no_surface,      ///< nothing there: the ray meets no geometry
  shadow,          ///< the projector does not see the point
  second_shadow,   ///< a second camera or projector does not see it
  saturated,       ///< too bright (specular)
  low_confidence,  ///< grazing incidence
  low_signal,      ///< too dark
  out_of_range,
  no_match,        ///< the matcher found no unique disparity
  defect,          ///< dead pixel, dust
  border,          ///< outside the overlap of the views
  dropped,         ///< lost at random
  unknown,         ///< the camera does not say
};
inline constexpr int reason_count = 13;

const char* reason_name(Reason reason);
std::optional<Reason> reason_from_name(const std::string& name);

enum class FrameStatus : std::uint8_t { complete, incomplete, timeout, device_lost };
const char* status_name(FrameStatus status);
std::optional<FrameStatus> status_from_name(const std::string& name);

/// An object whose pose is known: X_CO in mm, obj_id of the set's models.
struct ObjectPose {
  int obj_id = 0;
  Pose X_CO = Pose::Identity();
};

struct Frame {
  cv::Mat depth_mm;  ///< CV_32F, height x width, 0 where invalid
  cv::Mat reason;    ///< CV_8U, values of Reason; measured (0) exactly where depth_mm > 0
  cv::Mat ir;        ///< CV_16U or CV_8U, raw counts (full scale: SensorInfo::ir_full_scale); empty = none
  cv::Mat rgb;       ///< CV_8UC3 in the order R, G, B; empty = none
  cv::Mat ids;       ///< CV_16U, 0 = none of them, k = visible part of objects[k-1] (or of the k-th region); empty = unknown

  Camera camera;
  std::optional<Pose> X_WC;                        ///< pose of the camera in the world; absent = unknown
  std::optional<std::vector<ObjectPose>> objects;  ///< ground truth; absent = unknown

  double depth_scale_mm = 0;           ///< the step in which the device stores depth; 0 = not stored in steps
  std::optional<double> time_s;        ///< device time
  std::optional<double> host_time_s;   ///< arrival at the host
  std::int64_t sequence = 0;           ///< the device's own frame counter
  FrameStatus status = FrameStatus::complete;
  double missing_share = 0;            ///< share of the frame that never arrived (status incomplete)

  /// Throws Error naming `where` if shapes or types differ from the above, if a depth is negative, not finite, or
  /// contradicts its reason. Cheap: one pass. A timeout or a lost device may come without images.
  void check(const std::string& where) const;
};

/// What differs first between two frames, in words ("depth at (12, 3): 801.2 against 801.4"), or "" if they are equal
/// in everything that a recording keeps. Poses and intrinsics are compared to 1e-9 relative.
std::string difference(const Frame& a, const Frame& b);

/// Sets depth to 0 and the reason to `reason` in one pixel.
inline void invalidate(Frame& frame, int row, int col, Reason reason) {
  frame.depth_mm.at<float>(row, col) = 0.f;
  frame.reason.at<std::uint8_t>(row, col) = static_cast<std::uint8_t>(reason);
}

}  // namespace binrig
