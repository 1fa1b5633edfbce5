// The one interface of everything that delivers frames: synthetic sensor, recording, camera.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "core/frame.h"

namespace binrig {

/// What is known of a sensor apart from its frames; every optional may be absent where unknown.
struct SensorInfo {
  std::string name, principle, serial;
  std::optional<double> baseline_mm;
  std::optional<Vector3> projector_xyz_mm;              ///< in the camera frame
  std::optional<std::array<double, 2>> range_mm;        ///< min, max
  std::optional<double> frame_rate_hz;
  std::optional<double> ir_full_scale;                  ///< counts; default 255 for 8-bit IR, 65535 for 16-bit

  /// The projector's place: projector_xyz_mm, else (baseline_mm, 0, 0), else absent.
  std::optional<Vector3> projector() const;
};

struct SourceInfo {
  std::string uri;
  SensorInfo sensor;
  Camera camera;                      ///< of the first frame; a frame's own camera counts
  double depth_scale_mm = 0;          ///< as in Frame
  std::optional<std::int64_t> frames;   ///< number of frames; absent = endless or unknown
  bool power_on = false;              ///< the first frame follows power-on at once
  cv::Mat valid_region;               ///< CV_8U, outside (0) an invalid pixel says nothing; empty = the whole image
};

/// Contract (checked by the conformance suite for every kind of source):
/// info() works at any time; start() before next(), else next() throws Error; start() twice throws Error; stop() is
/// idempotent and start() after stop() begins anew; every Frame passes Frame::check; after the last frame next()
/// returns nothing, again and again; no frame arriving in time is a Frame with status timeout, not an error.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual SourceInfo info() const = 0;
  virtual void start() = 0;
  virtual std::optional<Frame> next(std::chrono::milliseconds timeout) = 0;
  virtual void stop() = 0;
};

}  // namespace binrig
