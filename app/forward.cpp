#include "app/forward.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "calib/plane_fit.h"
#include "core/error.h"
#include "core/progress.h"
#include "sim/effect.h"
#include "sim/scene_forward_model.h"

namespace binrig {
namespace {

ScenePlane scene_plane(const PlaneFit& fit) {
  ScenePlane plane;
  plane.normal = fit.normal;
  plane.offset_mm = fit.offset_mm;
  plane.surface.assumed = true;
  return plane;
}

// One plane a frame: a hand-held camera drifts between them.
std::vector<ScenePlane> planes_of_target(const CaptureReader& capture, bool region_masks, std::string& note) {
  std::vector<ScenePlane> planes;
  double nearest = 1e9, farthest = 0;
  for (int i = 0; i < capture.size(); ++i) {
    const Frame frame = capture.frame(i);
    const PixelRays rays(frame.camera);
    const cv::Mat mask = region_masks && !frame.ids.empty() ? cv::Mat(frame.ids == 1) : cv::Mat();
    const PlaneFit fit = fit_plane(frame.depth_mm, rays, mask);
    planes.push_back(scene_plane(fit));
    nearest = std::min(nearest, fit.distance_mm);
    farthest = std::max(farthest, fit.distance_mm);
  }
  note = fmt::format("{}: no pose; a plane was fitted to each frame ({:.1f} .. {:.1f} mm)", capture.info().key(), nearest, farthest);
  return planes;
}

// The table that posed objects stand on: the largest flat region of what the meshes do not explain.
std::optional<ScenePlane> table_of_scene(const CaptureReader& capture, const SceneForwardModel* meshes, int index, std::string& note) {
  const Frame frame = capture.frame(0);
  cv::Mat unexplained = frame.depth_mm.clone();
  if (meshes) {
    static const SensorModel perfect = parse_sensor_model("name: perfect\n", "perfect", effect_catalogue());
    const auto channels = meshes->perfect(index, 0, Offset{}, static_cast<ChannelSet>(Channel::depth), perfect);
    unexplained.setTo(0, channels->depth_mm > 0);
  }
  const int measured = cv::countNonZero(frame.depth_mm), left = cv::countNonZero(unexplained);
  if (left < measured / 3) return std::nullopt;
  try {
    const PlaneFit fit = fit_plane(unexplained, PixelRays(frame.camera));
    note = fmt::format("{}: {:.0f} % of the surface has no mesh; its largest flat part was fitted as a plane (RMS {:.2f} mm)",
                       capture.info().key(), 100.0 * left / measured, fit.rms_orthogonal_mm);
    return scene_plane(fit);
  } catch (const Error& problem) {
    note = fmt::format("{}: {:.0f} % of the surface has no mesh, and no plane fits it", capture.info().key(), 100.0 * left / measured);
    return std::nullopt;
  }
}

bool has_poses(const CaptureReader& capture) {
  const Frame header = capture.header(0);
  return header.objects && !header.objects->empty();
}

}  // namespace

Forward open_forward_model(const std::string& set_path, const ForwardOptions& options) {
  const RecordingSet set = RecordingSet::open(set_path);
  Forward forward;
  SceneOptions scene;
  scene.renderer = options.renderer;
  scene.with_ir = options.with_ir;
  const auto chosen = [&](const CaptureInfo& info) {
    return options.captures.empty() ||
           std::find(options.captures.begin(), options.captures.end(), info.key()) != options.captures.end();
  };

  Progress progress("fitting planes", static_cast<std::int64_t>(set.captures().size()));
  std::vector<CaptureReader> posed;
  for (const CaptureInfo& info : set.captures()) {
    progress.advance();
    const CaptureReader capture = set.capture(info.key());
    if (!chosen(info) || capture.size() == 0 || !capture.has_depth()) continue;
    std::string note;
    if (has_poses(capture)) {
      if (info.target == TargetKind::scene) posed.push_back(capture);
      continue;
    }
    try {
      if (info.target == TargetKind::plane) {
        scene.planes[info.key()] = planes_of_target(capture, set.info().region_masks, note);
      } else if (const auto table = table_of_scene(capture, nullptr, 0, note)) {
        scene.planes[info.key()] = {*table};
      }
    } catch (const Error& problem) {
      note = info.key() + " cannot be simulated: " + problem.what();
    }
    if (!note.empty()) forward.notes.push_back(note);
  }
  if (!posed.empty()) {  // the meshes first, then what they leave
    const SceneForwardModel meshes(set, scene);
    for (const CaptureReader& capture : posed) {
      int index = -1;
      for (std::size_t i = 0; i < meshes.captures().size(); ++i) {
        if (meshes.captures()[i].key() == capture.info().key()) index = static_cast<int>(i);
      }
      std::string note;
      if (index < 0) continue;
      if (const auto table = table_of_scene(capture, &meshes, index, note)) scene.planes[capture.info().key()] = {*table};
      if (!note.empty()) forward.notes.push_back(note);
    }
  }
  forward.model = std::make_unique<SceneForwardModel>(set, scene);
  return forward;
}

}  // namespace binrig
