// The sensor: an ordered list of effects put on perfect channels, frame by frame.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "core/frame.h"
#include "core/sensor_model.h"
#include "sim/effect.h"

namespace binrig {

/// The sensor on one capture. Frames come in order; memory does not grow with their number.
class SensorRun {
 public:
  /// `context` is complete but for `instance` and `model_folder`. Effects whose needs the capture does not meet are
  /// left out and listed by inactive(). The model must have been checked. The model may go; the context is copied.
  SensorRun(const SensorModel& model, const CaptureContext& context);
  ~SensorRun();

  /// Puts the sensor on the perfect channels of one frame. depth_mm, reason and ir of the result are filled, and the
  /// camera and depth_scale_mm; poses, times and ids are the caller's.
  /// Order: as the stages; at the end of the noise stage the noise layer joins the depth; the last step rounds to
  /// depth_scale_mm. A depth that falls to 0 or below, or beyond 16 bits of the scale, becomes out_of_range.
  Frame frame(const Channels& channels, const FrameInstant& instant);

  /// Channels that the present effects read, and those that a frame needs (depth; ir where `with_ir`).
  static ChannelSet needed_channels(const SensorModel& model, bool with_ir);
  /// id and reason in words of the effects that do not act on this capture.
  const std::vector<std::pair<std::string, std::string>>& inactive() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The one call for other people's simulators: perfect depth (CV_32F, mm, 0 = no surface) in, what the sensor says out.
/// Normals, edges and the projector's shadow are derived from the depth itself (the shadow by projecting the depth
/// image into the projector; what the camera does not see cannot cast one). Throws Error if the model does not fit.
Frame apply_sensor(const SensorModel& model, const cv::Mat& perfect_depth_mm, const Camera& camera, std::uint64_t seed,
                   int frame_number = 0);

/// The channels that perfect depth alone determines, for apply_sensor and `binrig apply`.
std::shared_ptr<const Channels> channels_from_depth(const cv::Mat& perfect_depth_mm, const Camera& camera,
                                                    const std::optional<Vector3>& projector_xyz_mm,
                                                    double reference_distance_mm, ChannelSet wanted);

}  // namespace binrig
