// The synthetic sensor over a world: the same frames that a camera there would deliver.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "core/frame_source.h"
#include "core/sensor_model.h"
#include "sim/renderer.h"
#include "sim/world.h"

namespace binrig {

/// Where a world is at this moment. A live one (parts fall, bins are shaken) answers with what lies there now.
struct WorldProvider {
  std::function<std::shared_ptr<const World>()> now;
  std::function<void(int scene)> begin_scene;  ///< scene k = 0, 1, ... of a series; may be empty
};
/// A world that stays as it is. Throws Error if it has parts that would have to fall first.
WorldProvider fixed_world(World world);
/// Fixed where every part has a pose; else a live one, whose parts fall into the bins anew for every (seed, scene).
WorldProvider world_in_motion(World world, std::uint64_t seed);

struct SyntheticOptions {
  int sensor = 0;  ///< index into the world's sensors
  std::uint64_t seed = 1;
  bool with_ir = true, with_rgb = false;
};

/// One sensor of a world at work.
class SyntheticCamera {
 public:
  /// Throws Error: no such sensor, a model that says `camera: recording` where the world's sensor has no camera, a
  /// model that does not fit.
  SyntheticCamera(WorldProvider world, const SensorModel& model, const SyntheticOptions& options = {});
  ~SyntheticCamera();

  SourceInfo info() const;
  /// Scene k: the mount's pose k (in turn), draws of its own (capture key "scene/k"), frame numbers from 0. Frame i of
  /// scene k is the same whatever was asked for before.
  void begin_scene(int scene, int frames);
  /// The next frame. objects = the world's parts in its order, ids = their visible pixels; bins and table have no id.
  Frame frame();
  /// What the last frame showed.
  const RenderScene& scene() const;
  const RenderRequest& request() const;
  const Renderer& renderer() const;
  const World& world() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// `scenes` scenes of `frames` frames each; frames 0 = endless (of scene 0).
std::unique_ptr<FrameSource> make_synthetic_source(const std::string& uri, WorldProvider world,
                                                   const SensorModel& model, const SyntheticOptions& options,
                                                   int scenes, int frames);

}  // namespace binrig
