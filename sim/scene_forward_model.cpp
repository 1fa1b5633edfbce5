#include "sim/scene_forward_model.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <optional>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "sim/channel_cache.h"
#include "sim/dot_pattern/instrument.h"
#include "sim/effect.h"
#include "sim/sensor.h"

namespace binrig {
namespace {

struct CaptureScene {
  CaptureInfo info;
  CaptureReader reader;
  int width = 0, height = 0;    // px, where the headers do not say
  std::vector<int> frames;      // indices of the readable ones in the reader
  std::vector<double> times_s;  // since the first frame
  bool posed = false, motion = false;
  std::vector<ScenePlane> planes;
  std::vector<SceneObject> extra_objects;

  int size() const { return static_cast<int>(frames.size()); }
  /// Camera, poses, times of frame i; made when asked for, so that a long capture needs no memory.
  Frame header(int i) const {
    Frame header = reader.header(frames.at(i));
    if (header.camera.width == 0) {
      header.camera.width = width;
      header.camera.height = height;
    }
    if (!posed) header.objects.reset();
    return header;
  }
};

ScenePlane moved(const ScenePlane& plane, const Pose& motion) {
  const Vector3 point = motion * (plane.normal * plane.offset_mm);
  ScenePlane result = plane;
  result.normal = motion.linear() * plane.normal;
  result.offset_mm = result.normal.dot(point);
  return result;
}

Pose interpolated(const Pose& a, const Pose& b, double t) {
  const Eigen::AngleAxisd turn(a.linear().transpose() * b.linear());
  Pose pose = Pose::Identity();
  pose.linear() = a.linear() * Eigen::AngleAxisd(t * turn.angle(), turn.axis()).toRotationMatrix();
  pose.translation() = (1 - t) * a.translation() + t * b.translation();
  return pose;
}

bool same_poses(const std::optional<std::vector<ObjectPose>>& a, const std::optional<std::vector<ObjectPose>>& b) {
  if (a.has_value() != b.has_value()) return false;
  if (!a) return true;
  return std::equal(a->begin(), a->end(), b->begin(), b->end(), [](const ObjectPose& p, const ObjectPose& q) {
    return p.obj_id == q.obj_id && p.X_CO.matrix() == q.X_CO.matrix();
  });
}

double median_train_depth(const RecordingSet& set) {
  std::vector<float> values;
  for (const CaptureInfo& info : set.captures()) {
    if (info.split != "train") continue;
    const CaptureReader reader = set.capture(info.key());
    if (reader.size() == 0 || !reader.has_depth()) continue;
    const Frame frame = reader.frame(0);
    for (int row = 0; row < frame.depth_mm.rows; row += 3) {
      for (int col = 0; col < frame.depth_mm.cols; col += 3) {
        if (frame.depth_mm.at<float>(row, col) > 0) values.push_back(frame.depth_mm.at<float>(row, col));
      }
    }
  }
  if (values.empty()) return 1000;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

}  // namespace

struct SceneForwardModel::Impl {
  RecordingSet set;
  SceneOptions options;
  std::unique_ptr<Renderer> renderer;
  std::vector<CaptureInfo> infos;
  std::vector<CaptureScene> scenes;
  std::map<int, std::shared_ptr<const Mesh>> meshes;
  bool reflectance_known = false;
  mutable ChannelCache cache;
  mutable std::once_flag median_once;
  mutable double median_mm = 0;

  explicit Impl(const RecordingSet& s, const SceneOptions& o) : set(s), options(o), cache(o.cache_mb << 20) {}

  std::shared_ptr<const Mesh> mesh_of(const ModelInfo& model) {
    auto mesh = std::make_shared<Mesh>(*load_mesh(model.mesh_path));
    Surface surface = mesh->surfaces.front();
    surface.albedo = static_cast<float>(model.albedo.value_or(0.5));
    surface.specular = static_cast<float>(model.specular.value_or(0.0));
    surface.shininess = static_cast<float>(model.shininess.value_or(30.0));
    surface.assumed = !model.albedo || !model.specular;
    reflectance_known |= !surface.assumed;
    mesh->surfaces.assign(1, surface);
    mesh->triangle_surface.clear();
    return mesh;
  }

  void load_meshes(const CaptureInfo& info, const std::vector<ObjectPose>& objects) {
    for (const ObjectPose& object : objects) {
      if (meshes.count(object.obj_id)) continue;
      const auto model = std::find_if(set.models().begin(), set.models().end(),
                                      [&](const ModelInfo& m) { return m.obj_id == object.obj_id; });
      if (model == set.models().end()) {
        throw Error(fmt::format("{}: {} has an object {} that models/ does not know", set.info().path, info.key(),
                                object.obj_id));
      }
      meshes[object.obj_id] = mesh_of(*model);
    }
  }

  // The capture as a scene, or nothing where it cannot be simulated.
  std::optional<CaptureScene> scene_of(const CaptureInfo& info) {
    CaptureScene scene;
    scene.info = info;
    scene.reader = set.capture(info.key());
    if (const auto found = options.planes.find(info.key()); found != options.planes.end()) scene.planes = found->second;
    if (const auto found = options.objects.find(info.key()); found != options.objects.end())
      scene.extra_objects = found->second;
    scene.posed = true;
    const double rate = set.info().sensor.frame_rate_hz.value_or(1.0);
    std::optional<Frame> first;
    for (int i = 0; i < scene.reader.size(); ++i) {
      Frame header;
      try {
        header = scene.reader.header(i);
        if (header.camera.width == 0 && scene.width == 0) {  // camera.json may not say the size
          const Camera camera = scene.reader.frame(i).camera;
          scene.width = camera.width;
          scene.height = camera.height;
        }
      } catch (const Error&) {
        continue;  // a broken frame is reported by whoever reads its image
      }
      if (!first) first = header;
      scene.posed &= header.objects.has_value() && !header.objects->empty();
      scene.motion |= !same_poses(header.objects, first->objects);
      scene.times_s.push_back(first->time_s && header.time_s ? *header.time_s - *first->time_s : scene.size() / rate);
      scene.frames.push_back(i);
      if (header.objects) load_meshes(info, *header.objects);
    }
    scene.motion &= scene.posed;
    if (scene.frames.empty() || (!scene.posed && scene.planes.empty() && scene.extra_objects.empty()))
      return std::nullopt;
    return scene;
  }
};

SceneForwardModel::SceneForwardModel(const RecordingSet& set, const SceneOptions& options)
    : impl_(std::make_unique<Impl>(set, options)) {
  impl_->renderer = make_renderer(options.renderer);
  for (const CaptureInfo& info : set.captures()) {
    if (auto scene = impl_->scene_of(info)) {
      scene->info.frames = scene->size();
      impl_->infos.push_back(scene->info);
      impl_->scenes.push_back(std::move(*scene));
    }
  }
  if (impl_->scenes.empty()) {
    throw Error(set.info().path +
                " cannot be simulated: no capture has poses (scene_gt.json) with meshes, and no plane was found");
  }
}

SceneForwardModel::~SceneForwardModel() = default;

const EffectCatalogue& SceneForwardModel::catalogue() const { return effect_catalogue(); }
const std::vector<CaptureInfo>& SceneForwardModel::captures() const { return impl_->infos; }
const SetInfo& SceneForwardModel::set() const { return impl_->set.info(); }
cv::Mat SceneForwardModel::region(int capture) const { return impl_->set.region(impl_->infos.at(capture)); }
const Renderer& SceneForwardModel::renderer() const { return *impl_->renderer; }

double SceneForwardModel::reference_distance_mm(const SensorModel& model) const {
  if (model.reference_from == Given::written) return model.reference_distance_mm;
  if (const auto& range = set().sensor.range_mm) return 0.5 * ((*range)[0] + (*range)[1]);
  std::call_once(impl_->median_once, [&] { impl_->median_mm = median_train_depth(impl_->set); });
  return impl_->median_mm;
}

RenderScene SceneForwardModel::scene_at(int capture, double time_s, const Offset& offset) const {
  const CaptureScene& scene = impl_->scenes.at(capture);
  const auto& times = scene.times_s;
  std::size_t frame = 0;
  while (frame + 1 < times.size() && times[frame + 1] <= time_s) ++frame;
  RenderScene result;
  if (scene.posed) {
    std::size_t a = frame;
    double t = 0;
    if (scene.motion && times.size() > 1) {
      a = std::min(frame, times.size() - 2);
      const double span = times[a + 1] - times[a];
      t = span > 0 ? (time_s - times[a]) / span : 0;
    }
    const std::vector<ObjectPose> here = *scene.header(static_cast<int>(a)).objects;
    const std::vector<ObjectPose> next = t != 0 ? *scene.header(static_cast<int>(a) + 1).objects : here;
    for (std::size_t i = 0; i < here.size(); ++i) {
      SceneObject object;
      object.obj_id = here[i].obj_id;
      object.mesh = impl_->meshes.at(object.obj_id);
      const bool moves = t != 0 && i < next.size() && next[i].obj_id == here[i].obj_id;
      object.X_CO = moves ? interpolated(here[i].X_CO, next[i].X_CO, t) : here[i].X_CO;
      result.objects.push_back(std::move(object));
    }
  }
  result.objects.insert(result.objects.end(), scene.extra_objects.begin(), scene.extra_objects.end());
  if (!scene.planes.empty()) result.plane = scene.planes[std::min(frame, scene.planes.size() - 1)];

  if (!offset.pose.isZero()) {
    Vector3 centroid = Vector3::Zero();
    for (const SceneObject& object : result.objects)
      centroid += object.X_CO.translation() / static_cast<double>(result.objects.size());
    if (result.objects.empty()) {
      centroid = Vector3(0, 0, result.plane->offset_mm / result.plane->normal.z());  // where the optical axis meets it
    }
    const Pose motion = small_motion(offset.pose, centroid);
    for (SceneObject& object : result.objects) object.X_CO = motion * object.X_CO;
    if (result.plane) result.plane = moved(*result.plane, motion);
  }
  return result;
}

RenderRequest SceneForwardModel::request_for(int capture, int frame, const Offset& offset,
                                             const SensorModel& model) const {
  RenderRequest request;
  request.camera = impl_->scenes.at(capture).header(frame).camera;
  if (model.camera_from == Given::written) {
    const Camera& m = model.camera;
    const bool same = m.width == request.camera.width && m.height == request.camera.height &&
                      std::abs(m.fx - request.camera.fx) <= 0.05 * request.camera.fx;
    if (!same) {
      throw Error(fmt::format(
          "{} was recorded with another camera than the model's: {} x {} px, f = {:.1f} px against {} x {} px, f = "
          "{:.1f} px",
          set().path, request.camera.width, request.camera.height, request.camera.fx, m.width, m.height, m.fx));
    }
  }
  request.camera.fx += offset.focal_px;
  request.camera.fy += offset.focal_px;
  request.camera.cx += offset.cx_px;
  request.camera.cy += offset.cy_px;
  if (model.projector_known)
    request.projector_xyz_mm = model.projector_xyz_mm;
  else if (model.projector_from == Given::recording)
    request.projector_xyz_mm = set().sensor.projector();
  request.reference_distance_mm = reference_distance_mm(model);
  return request;
}

std::shared_ptr<const Channels> SceneForwardModel::perfect(int capture, int frame, const Offset& offset,
                                                           ChannelSet wanted, const SensorModel& model) const {
  RenderRequest request = request_for(capture, frame, offset, model);
  request.wanted = wanted | Channel::depth;
  const RenderScene scene = scene_at(capture, impl_->scenes[capture].times_s.at(frame), offset);
  return impl_->cache.render(*impl_->renderer, scene, request);
}

void SceneForwardModel::simulate(const SimulationRequest& request, const FrameSink& sink) const {
  const CaptureScene& scene = impl_->scenes.at(request.capture);
  const SensorModel& model = *request.model;
  const int recorded = scene.size();
  const int frames = request.frames > 0 ? request.frames : recorded;

  CaptureContext context;
  const RenderRequest nominal = request_for(request.capture, 0, Offset{}, model);
  context.camera = nominal.camera;
  context.projector_xyz_mm = nominal.projector_xyz_mm;
  context.reference_distance_mm = nominal.reference_distance_mm;
  context.depth_scale_mm =
      model.depth_scale_from == Given::written ? model.depth_scale_mm : scene.header(0).depth_scale_mm;
  context.frames = frames;
  context.power_on = scene.info.power_on;
  context.motion = scene.motion;
  context.seed = request.seed;
  context.unit_seed = model.unit_seed;
  context.capture_key = hash_text(scene.info.key());
  context.render = [&](const View& view, int frame) {
    const int source = std::min(frame, recorded - 1);
    RenderRequest other = request_for(request.capture, source, request.offset, model);
    // The view is asked for relative to the nominal camera; what the lens really is stays.
    other.camera = view.camera;
    other.camera.fx += request.offset.focal_px;
    other.camera.fy += request.offset.focal_px;
    other.camera.cx += request.offset.cx_px;
    other.camera.cy += request.offset.cy_px;
    if (view.projector_xyz_mm) other.projector_xyz_mm = view.projector_xyz_mm;
    other.wanted = view.wanted | Channel::depth;
    const RenderScene moved_scene =
        scene_at(request.capture, view.time_s.value_or(scene.times_s[source]), request.offset);
    return impl_->cache.render(*impl_->renderer, moved_scene, other);
  };

  std::unique_ptr<dot_pattern::Instrument> instrument;
  std::unique_ptr<SensorRun> run;
  ChannelSet wanted = 0;
  if (model.dot_pattern) {
    dot_pattern::Geometry geometry;
    geometry.nominal = nominal.camera;
    geometry.actual = request_for(request.capture, 0, request.offset, model).camera;
    if (!nominal.projector_xyz_mm)
      throw Error(set().path + ": the projector's place is unknown; write it in the model");
    geometry.second_view_mm = *nominal.projector_xyz_mm;
    const double z0 = nominal.reference_distance_mm;
    geometry.range_mm =
        model.range_mm.value_or(set().sensor.range_mm.value_or(std::array<double, 2>{0.75 * z0, 1.25 * z0}));
    geometry.reference_distance_mm = z0;
    geometry.depth_scale_mm = context.depth_scale_mm;
    geometry.seed = context.seed;
    geometry.unit_seed = context.unit_seed;
    geometry.capture_key = context.capture_key;
    instrument = std::make_unique<dot_pattern::Instrument>(model, geometry, *impl_->renderer);
  } else {
    wanted = SensorRun::needed_channels(model, impl_->options.with_ir);
    run = std::make_unique<SensorRun>(model, context);
  }
  for (int number = 0; number < frames; ++number) {
    const int source = std::min(number, recorded - 1);
    FrameInstant instant;
    instant.number = number;
    instant.time_s = scene.times_s[source];
    if (number >= recorded) instant.time_s += (number - source) / set().sensor.frame_rate_hz.value_or(1.0);
    if (scene.info.power_on) instant.since_power_on_s = instant.time_s;
    Frame frame;
    if (instrument) {
      frame = instrument->frame(scene_at(request.capture, scene.times_s[source], request.offset), number,
                                instant.since_power_on_s);
      if (!impl_->options.with_ir) frame.ir.release();
    } else {
      frame = run->frame(*perfect(request.capture, source, request.offset, wanted, model), instant);
    }
    const Frame header = scene.header(source);
    frame.camera = header.camera;
    frame.objects = header.objects;
    frame.X_WC = header.X_WC;
    frame.time_s = instant.time_s;
    frame.sequence = number;
    sink(frame, number);
  }
}

std::vector<std::pair<std::string, std::string>> SceneForwardModel::inactive(const SensorModel& model) const {
  const bool baseline = request_for(0, 0, Offset{}, model).projector_xyz_mm.has_value();
  bool power_on = false, motion = false, repeats = false;
  for (const CaptureScene& scene : impl_->scenes) {
    power_on |= scene.info.power_on;
    motion |= scene.motion;
    repeats |= scene.size() > 1;
  }
  std::vector<std::pair<std::string, std::string>> list;
  for (const EffectInstance& instance : model.effects) {
    const Needs& needs = instance.declaration(catalogue()).needs;
    std::string lacks;
    auto lack = [&](bool needed, bool there, const char* word) {
      if (needed && !there) lacks += (lacks.empty() ? "" : ", ") + std::string(word);
    };
    lack(needs.baseline, baseline, "the projector's place");
    lack(needs.power_on, power_on, "a series from power-on");
    lack(needs.motion, motion, "a moving target");
    lack(needs.repeats, repeats, "repeated frames");
    lack(needs.ir, impl_->reflectance_known, "the targets' reflectance");
    if (!lacks.empty()) list.emplace_back(instance.id, "the recording lacks " + lacks);
  }
  return list;
}

}  // namespace binrig
