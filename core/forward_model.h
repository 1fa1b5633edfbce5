// The forward model: what a sensor model would have recorded of given captures. compare/, calib/ and diagnose/ know
// simulation through this interface alone; sim/ implements it and app/ hands it in.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "core/channels.h"
#include "core/effect_declaration.h"
#include "core/frame.h"
#include "core/recording_set.h"
#include "core/sensor_model.h"

namespace binrig {

/// Where the capture really stood and what the lens really was, as departures from nominal. All zero = nominal.
struct Offset {
  Vector6 pose = Vector6::Zero();  ///< small_motion of all objects in the camera frame, about the targets' centroid
  double focal_px = 0, cx_px = 0, cy_px = 0;
  bool operator==(const Offset& other) const {
    return pose == other.pose && focal_px == other.focal_px && cx_px == other.cx_px && cy_px == other.cy_px;
  }
};

struct SimulationRequest {
  int capture = 0;          ///< index into captures()
  const SensorModel* model = nullptr;
  Offset offset;            ///< of the true scene; the frames carry the nominal camera and poses all the same
  std::uint64_t seed = 1;   ///< keys everything that changes between recordings
  int frames = 0;           ///< 0 = as many as the capture has
};

/// One simulated frame; `channels` are the perfect ones of the nominal scene at that frame.
using FrameSink = std::function<void(const Frame& frame, int number)>;

class ForwardModel {
 public:
  virtual ~ForwardModel() = default;

  virtual const EffectCatalogue& catalogue() const = 0;
  /// The captures that can be simulated, in the set's order.
  virtual const std::vector<CaptureInfo>& captures() const = 0;
  virtual const SetInfo& set() const = 0;
  /// RecordingSet::region of a capture: CV_8U, outside (0) its recording says nothing of its target. Empty = everywhere.
  virtual cv::Mat region(int capture) const = 0;

  /// Perfect channels of a capture's frame under an offset. Cached: frames of a static capture share one object.
  /// `z0_mm` is the reference distance that diffuse light is scaled with. Throws Error if a mesh cannot be loaded.
  virtual std::shared_ptr<const Channels> perfect(int capture, int frame, const Offset& offset, ChannelSet wanted,
                                                  const SensorModel& model) const = 0;

  /// Makes frame after frame, streaming. Thread-safe: several captures may be simulated at once.
  virtual void simulate(const SimulationRequest& request, const FrameSink& sink) const = 0;

  /// The effects of `model` that cannot act on this set because its needs are not met: id and reason in words.
  virtual std::vector<std::pair<std::string, std::string>> inactive(const SensorModel& model) const = 0;
};

}  // namespace binrig
