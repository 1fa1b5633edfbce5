#include "app/plane_simulation.h"

#include "core/random.h"
#include "sim/renderer.h"
#include "sim/sensor.h"

namespace binrig {

FrameStream simulate_plane(const SensorModel& model, const PlaneSimulation& s, int repeats) {
  RenderScene scene;
  scene.plane = ScenePlane{.normal = s.normal, .offset_mm = s.offset_mm, .surface = {}};
  scene.plane->surface.assumed = true;
  CaptureContext context;
  context.camera = s.camera;
  context.projector_xyz_mm = model.projector_known ? std::optional(model.projector_xyz_mm) : s.projector_xyz_mm;
  context.reference_distance_mm =
      model.reference_from == Given::written ? model.reference_distance_mm : s.reference_distance_mm;
  context.depth_scale_mm = model.depth_scale_from == Given::written ? model.depth_scale_mm : s.depth_scale_mm;
  context.frames = s.frames;
  context.unit_seed = model.unit_seed;
  context.capture_key = hash_text(s.capture);
  RenderRequest request;
  request.camera = s.camera;
  request.projector_xyz_mm = context.projector_xyz_mm;
  request.reference_distance_mm = context.reference_distance_mm;
  request.wanted = SensorRun::needed_channels(model, false);
  const std::shared_ptr<const Channels> channels = make_renderer("plane")->render(scene, request);
  context.render = [scene, request](const View& view, int) {
    RenderRequest other = request;
    other.camera = view.camera;
    if (view.projector_xyz_mm) other.projector_xyz_mm = view.projector_xyz_mm;
    other.wanted = view.wanted;
    return make_renderer("plane")->render(scene, other);
  };
  return [&model, s, context, channels, repeats](const FrameSink& sink) {
    int number = 0;
    for (int repeat = 0; repeat < repeats; ++repeat) {
      CaptureContext own = context;
      own.seed = s.seed + static_cast<std::uint64_t>(repeat);
      SensorRun run(model, own);
      for (int frame = 0; frame < s.frames; ++frame) {
        Frame made = run.frame(*channels, {.number = frame, .time_s = 0.1 * frame});
        sink(made, number++);
      }
    }
  };
}

}  // namespace binrig
