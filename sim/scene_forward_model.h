// The forward model over a recording set: its meshes at their poses (and planes where there is no mesh), rendered, and
// the sensor model put on top.
//
// Frames: C = camera, O = object. Offsets move everything in C about the targets' centroid.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/forward_model.h"
#include "core/recording_set.h"
#include "sim/renderer.h"

namespace binrig {

struct SceneOptions {
  std::string renderer = "auto";
  /// Planes for what has no mesh (a table, a wall), by capture key, one a frame (or one for all frames). A capture
  /// without poses is simulated if it has planes.
  std::map<std::string, std::vector<ScenePlane>> planes;
  /// Boxes and the like fitted to what has no mesh either, by capture key, fixed through the capture.
  std::map<std::string, std::vector<SceneObject>> objects;
  bool with_ir = false;        ///< fill Frame::ir (16-bit counts)
  std::size_t cache_mb = 420;  ///< bound of the cache of rendered channels
};

class SceneForwardModel : public ForwardModel {
 public:
  /// Throws Error if no capture of the set can be simulated (neither poses with meshes nor planes), or a mesh is bad.
  SceneForwardModel(const RecordingSet& set, const SceneOptions& options = {});
  ~SceneForwardModel() override;

  const EffectCatalogue& catalogue() const override;
  const std::vector<CaptureInfo>& captures() const override;
  const SetInfo& set() const override;
  cv::Mat region(int capture) const override;
  std::shared_ptr<const Channels> perfect(int capture, int frame, const Offset& offset, ChannelSet wanted,
                                          const SensorModel& model) const override;
  void simulate(const SimulationRequest& request, const FrameSink& sink) const override;
  std::vector<std::pair<std::string, std::string>> inactive(const SensorModel& model) const override;

  /// The scene of a capture at a device time (s since the capture's first frame): poses between frames are
  /// interpolated, beyond the ends extrapolated from the nearest two frames.
  RenderScene scene_at(int capture, double time_s, const Offset& offset) const;
  /// What is rendered for a model: camera of a frame (nominal plus offset), projector, reference distance.
  RenderRequest request_for(int capture, int frame, const Offset& offset, const SensorModel& model) const;
  /// z0 of EFFECTS.md for this set: as written in the model, else the middle of range_mm, else the median depth of the
  /// train captures' first frames.
  double reference_distance_mm(const SensorModel& model) const;
  const Renderer& renderer() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace binrig
