#include "app/forward.h"

#include <algorithm>
#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/box_fit.h"
#include "calib/plane_fit.h"
#include "calib/projector_fit.h"
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
    const cv::Mat mask = marked_region(frame, region_masks);
    const PlaneFit fit = fit_plane(frame.depth_mm, rays, mask);
    planes.push_back(scene_plane(fit));
    nearest = std::min(nearest, fit.distance_mm);
    farthest = std::max(farthest, fit.distance_mm);
  }
  note = fmt::format("{}: no pose; a plane was fitted to each frame ({:.1f} .. {:.1f} mm)", capture.info().key(),
                     nearest, farthest);
  return planes;
}

// Pixels on the plane, wherever they are: within 4 sigma (at least 8 mm, for warped tables) of it.
cv::Mat on_plane(const cv::Mat& depth_mm, const PlaneFit& fit, const PixelRays& rays) {
  const cv::Mat distance = cv::abs(depth_mm - fit.perfect_depth(rays));
  return (distance < std::max(8.0, 4 * fit.sigma_mm)) & (depth_mm > 0);
}

// The flat thing that objects stand on, as far as it was seen, the shadows between it and the objects closed. Its outer
// rim is left out: a pixel missing there says nothing.
SceneObject table_object(const PlaneFit& fit, const Camera& camera, const cv::Mat& seen, const cv::Mat& objects) {
  cv::Mat solid;
  cv::morphologyEx(seen, solid, cv::MORPH_OPEN, cv::Mat::ones(5, 5, CV_8U));
  solid |= objects;
  const cv::Mat reach = cv::getStructuringElement(cv::MORPH_ELLIPSE, {61, 61});
  cv::copyMakeBorder(solid, solid, 40, 40, 40, 40, cv::BORDER_CONSTANT, 0);  // the image's border is no rim
  cv::morphologyEx(solid, solid, cv::MORPH_CLOSE, reach);
  cv::erode(solid, solid, cv::Mat::ones(17, 17, CV_8U));
  solid = solid(cv::Rect(40, 40, seen.cols, seen.rows)).clone();
  auto mesh = std::make_shared<Mesh>();
  mesh->name = "table";
  mesh->surfaces[0].assumed = true;
  for (const std::array<Vector3, 4>& cell : plane_patch(camera, solid, fit)) {
    const auto first = static_cast<std::uint32_t>(mesh->vertices.size());
    for (const Vector3& corner : cell) mesh->vertices.push_back(corner.cast<float>());
    mesh->triangles.push_back({first, first + 1, first + 2});
    mesh->triangles.push_back({first, first + 2, first + 3});
  }
  SceneObject object;
  object.mesh = mesh;
  return object;
}

// The table under posed objects: the largest flat region of what the meshes do not explain.
std::vector<SceneObject> table_of_scene(const CaptureReader& capture, const SceneForwardModel& meshes, int index,
                                        std::string& note) {
  const Frame frame = capture.frame(0);
  const SensorModel perfect = parse_sensor_model("name: perfect\n", "perfect", effect_catalogue());
  const auto channels = meshes.perfect(index, 0, Offset{}, static_cast<ChannelSet>(Channel::depth), perfect);
  cv::Mat unexplained = frame.depth_mm.clone();
  unexplained.setTo(0, channels->depth_mm > 0);
  const int measured = cv::countNonZero(frame.depth_mm), left = cv::countNonZero(unexplained);
  if (left < measured / 3) return {};
  const double share = 100.0 * left / measured;
  // The table is what the objects stand on: flat, near them in the image and in depth. Elsewhere lies the floor.
  const cv::Mat object = channels->depth_mm > 0;
  double nearest = 0, farthest = 0;
  cv::minMaxLoc(channels->depth_mm, &nearest, &farthest, nullptr, nullptr, object);
  cv::Mat near_objects;
  cv::dilate(object, near_objects, cv::getStructuringElement(cv::MORPH_ELLIPSE, {81, 81}));
  near_objects &= (unexplained > nearest - 100) & (unexplained < farthest + 200);
  const PixelRays rays(frame.camera);
  try {
    const PlaneFit fit = fit_plane(unexplained, rays, near_objects);
    note = fmt::format(
        "{}: {:.0f} % of the surface has no mesh; a plane was fitted to what surrounds the objects (RMS {:.2f} mm)",
        capture.info().key(), share, fit.rms_orthogonal_mm);
    return {table_object(fit, frame.camera, on_plane(unexplained, fit, rays), object)};
  } catch (const Error& problem) {
    note = fmt::format("{}: {:.0f} % of the surface has no mesh, and no plane fits what surrounds the objects",
                       capture.info().key(), share);
    return {};
  }
}

// A labelled scene without meshes: the first label is the table, the others become upright boxes on it.
std::vector<SceneObject> boxes_of_scene(const CaptureReader& capture, std::string& note) {
  const Frame frame = capture.frame(0);
  std::vector<SceneObject> objects;
  if (frame.ids.empty()) {
    note = capture.info().key() + ": neither poses nor labels, so it cannot be simulated";
    return objects;
  }
  const PixelRays rays(frame.camera);
  const PlaneFit table = fit_plane(frame.depth_mm, rays, frame.ids == 1);
  objects.push_back(
      table_object(table, frame.camera, on_plane(frame.depth_mm, table, rays) & (frame.ids == 1), frame.ids > 1));
  double labels = 0;
  cv::minMaxLoc(frame.ids, nullptr, &labels);
  std::string boxes;
  for (int label = 2; label <= static_cast<int>(labels); ++label) {
    const cv::Mat mask = frame.ids == label;
    if (cv::countNonZero(mask & (frame.depth_mm > 0)) < 50) continue;
    const BoxFit box = fit_box(frame.depth_mm, rays, mask, table);
    SceneObject object;
    Surface surface;
    surface.assumed = true;
    object.mesh = box_mesh(box.size_mm, surface);
    object.X_CO = box.X_CO;
    object.obj_id = label;
    objects.push_back(object);
    boxes += fmt::format("{}{:.0f} x {:.0f} x {:.0f} mm (RMS {:.1f})", boxes.empty() ? "" : ", ", box.size_mm.x(),
                         box.size_mm.y(), box.size_mm.z(), box.rms_mm);
  }
  note = fmt::format("{}: no meshes; a plane (RMS {:.2f} mm) and boxes were fitted to its labels: {}",
                     capture.info().key(), table.rms_orthogonal_mm, boxes);
  return objects;
}

// Depth that was moved into the view of another camera: recording.json says so.
bool depth_registered(const RecordingSet& set) {
  std::ifstream file(set.info().path + "/recording.json");
  const auto recording = nlohmann::json::parse(file, nullptr, false);
  if (!recording.is_object()) return false;
  if (recording.value("depth_registered", false)) return true;
  const auto note = recording.find("depth_note");
  return note != recording.end() && note->is_string() && note->get<std::string>().rfind("registered to colour", 0) == 0;
}

bool has_poses(const CaptureReader& capture) {
  for (int i = 0; i < capture.size(); ++i) {  // a capture with poses for some frames only is simulated like one without
    const Frame header = capture.header(i);
    if (!header.objects || header.objects->empty()) return false;
  }
  return true;
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
      } else if (auto objects = boxes_of_scene(capture, note); !objects.empty()) {
        scene.objects[info.key()] = std::move(objects);
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
      if (auto table = table_of_scene(capture, meshes, index, note); !table.empty()) {
        scene.objects[capture.info().key()] = std::move(table);
      }
      if (!note.empty()) forward.notes.push_back(note);
    }
  }
  forward.model = std::make_unique<SceneForwardModel>(set, scene);
  return forward;
}

std::string settle_projector(SensorModel& model, const ForwardModel& forward) {
  if (model.projector_from != Given::fit || model.projector_known) return "";
  const RecordingSet set = RecordingSet::open(forward.set().path);
  const auto second = std::find_if(model.effects.begin(), model.effects.end(),
                                   [](const EffectInstance& instance) { return instance.effect == "second_shadow"; });
  const bool there = second != model.effects.end();
  const ProjectorFit fit = fit_projector(forward, set, model, there || depth_registered(set));
  model.projector_known = fit.found;
  model.projector_xyz_mm = fit.xyz_mm;
  if (!fit.second_x_mm) return fit.message;
  if (there) {
    second->values["baseline"] = {*fit.second_x_mm, std::nullopt, "fitted to " + fit.captures.front()};
    return fit.message;
  }
  add_effect(model, forward.catalogue(), "second_shadow", {{"baseline", *fit.second_x_mm}});
  return fit.message + "; added as second_shadow, since this depth was registered to another camera";
}

}  // namespace binrig
