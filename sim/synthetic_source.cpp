#include "sim/synthetic_source.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/random.h"
#include "sim/dot_pattern/instrument.h"
#include "sim/live_world.h"
#include "sim/sensor.h"

namespace binrig {

namespace {
constexpr double default_frame_rate_hz = 10;
constexpr double default_depth_scale_mm = 0.1;

// 1, 2 or 5 times a power of ten, so that 16 bits reach the far end.
double fitting_scale_mm(double farthest_mm) {
  const double least = farthest_mm * 1.1 / 65535;
  const double power = std::pow(10, std::floor(std::log10(least)));
  for (double step : {1.0, 2.0, 5.0}) {
    if (step * power >= least) return step * power;
  }
  return 10 * power;
}

double median_depth_mm(const cv::Mat& depth) {
  std::vector<float> values;
  for (int row = 0; row < depth.rows; row += 3) {
    for (int col = 0; col < depth.cols; col += 3) {
      if (depth.at<float>(row, col) > 0) values.push_back(depth.at<float>(row, col));
    }
  }
  if (values.empty()) return 800;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}
}  // namespace

WorldProvider fixed_world(World world) {
  if (world.drops()) {
    throw Error(world.file +
                ": some of its parts have a count and fall into a bin; as a fixed world every part needs a pose");
  }
  auto shared = std::make_shared<const World>(std::move(world));
  return {[shared] { return shared; }, {}};
}

WorldProvider world_in_motion(World world, std::uint64_t seed) {
  if (!world.drops()) return fixed_world(std::move(world));
  auto live = std::make_shared<LiveWorld>(std::move(world), seed);
  return {[live] { return live->now(); }, [live](int scene) { live->begin_scene(scene); }};
}

struct SyntheticCamera::Impl {
  WorldProvider provider;
  SensorModel model;
  SyntheticOptions options;
  std::unique_ptr<Renderer> renderer;
  std::shared_ptr<const World> world;  // of the last picture
  RenderScene scene;
  RenderRequest request;
  std::shared_ptr<const Channels> channels;
  CaptureContext context;
  double frame_rate_hz = default_frame_rate_hz;
  std::array<double, 2> range_mm{};
  int scene_number = -1, frame_number = 0;
  Pose X_WC = Pose::Identity();
  std::unique_ptr<SensorRun> run;
  std::unique_ptr<dot_pattern::Instrument> instrument;

  const WorldSensor& sensor() const { return world->sensors[static_cast<std::size_t>(options.sensor)]; }

  void look(ChannelSet wanted) {
    auto now = provider.now();
    if (channels && now == world && (channels->present() & wanted) == wanted) return;
    world = std::move(now);
    scene = render_scene(*world, X_WC);
    request.wanted = wanted;
    channels = renderer->render(scene, request);
  }

  ChannelSet wanted() const {
    ChannelSet set = model.dot_pattern ? static_cast<ChannelSet>(Channel::depth)
                                       : SensorRun::needed_channels(model, options.with_ir);
    set = set | Channel::instance;
    if (options.with_rgb) set = set | Channel::rgb;
    return set;
  }
};

SyntheticCamera::SyntheticCamera(WorldProvider world, const SensorModel& model, const SyntheticOptions& options)
    : impl_(std::make_unique<Impl>()) {
  Impl& self = *impl_;
  self.provider = std::move(world);
  self.model = model;
  self.options = options;
  self.world = self.provider.now();
  self.renderer = make_renderer(self.world->renderer);
  if (options.sensor < 0 || options.sensor >= static_cast<int>(self.world->sensors.size())) {
    throw Error(self.world->file + " has " + std::to_string(self.world->sensors.size()) + " sensors, and no sensor " +
                std::to_string(options.sensor));
  }
  const WorldSensor& sensor = self.sensor();
  const std::string where = self.world->file + ", sensor " + sensor.name;
  if (model.camera_from == Given::written) {
    self.request.camera = model.camera;
  } else if (sensor.camera) {
    self.request.camera = *sensor.camera;
  } else {
    throw Error(where + " needs a camera: the model " + model.name + " says camera: recording");
  }
  if (model.projector_known) {
    self.request.projector_xyz_mm = model.projector_xyz_mm;
  } else {
    self.request.projector_xyz_mm = sensor.info.projector();
  }
  self.frame_rate_hz = model.frame_rate_hz.value_or(sensor.info.frame_rate_hz.value_or(default_frame_rate_hz));
  const auto range = model.range_mm ? model.range_mm : sensor.info.range_mm;
  if (model.depth_scale_from == Given::written) {
    self.context.depth_scale_mm = model.depth_scale_mm;
  } else {
    self.context.depth_scale_mm = range ? fitting_scale_mm((*range)[1]) : default_depth_scale_mm;
  }
  self.X_WC = sensor.X_WC.front();
  if (model.reference_from == Given::written) {
    self.request.reference_distance_mm = model.reference_distance_mm;
  } else if (range) {
    self.request.reference_distance_mm = ((*range)[0] + (*range)[1]) / 2;
  } else {
    self.look(static_cast<ChannelSet>(Channel::depth));
    self.request.reference_distance_mm = median_depth_mm(self.channels->depth_mm);
    self.channels.reset();
  }
  const double z0 = self.request.reference_distance_mm;
  self.range_mm = range.value_or(std::array<double, 2>{0.75 * z0, 1.25 * z0});
  begin_scene(0, 1);  // so that a model that does not fit is refused here
}

SyntheticCamera::~SyntheticCamera() = default;

SourceInfo SyntheticCamera::info() const {
  const Impl& self = *impl_;
  SourceInfo info;
  info.sensor = self.sensor().info;
  info.sensor.name = self.model.name;
  info.sensor.principle = self.model.dot_pattern ? "simulated: dot pattern" : "simulated: effects";
  info.sensor.projector_xyz_mm = self.request.projector_xyz_mm;
  if (self.request.projector_xyz_mm) info.sensor.baseline_mm = std::abs(self.request.projector_xyz_mm->x());
  info.sensor.range_mm = self.range_mm;
  info.sensor.frame_rate_hz = self.frame_rate_hz;
  info.sensor.ir_full_scale = 65535;
  info.camera = self.request.camera;
  info.depth_scale_mm = self.context.depth_scale_mm;
  return info;
}

void SyntheticCamera::begin_scene(int scene, int frames) {
  Impl& self = *impl_;
  if (scene != self.scene_number && self.provider.begin_scene) self.provider.begin_scene(scene);
  self.scene_number = scene;
  self.frame_number = 0;
  const auto& poses = self.sensor().X_WC;
  self.X_WC = poses[static_cast<std::size_t>(scene) % poses.size()];
  self.channels.reset();

  CaptureContext& context = self.context;
  context.camera = self.request.camera;
  context.projector_xyz_mm = self.request.projector_xyz_mm;
  context.reference_distance_mm = self.request.reference_distance_mm;
  context.frames = std::max(frames, 1);
  context.seed = self.options.seed;
  context.unit_seed = self.model.unit_seed;
  context.capture_key = hash_text("scene/" + std::to_string(scene));
  context.render = [&self](const View& view, int) {
    RenderRequest other = self.request;
    other.camera = view.camera;
    if (view.projector_xyz_mm) other.projector_xyz_mm = view.projector_xyz_mm;
    other.wanted = view.wanted | Channel::depth;
    return self.renderer->render(self.scene, other);  // what lies there stands still while a frame is taken
  };
  if (self.model.dot_pattern) {
    if (!context.projector_xyz_mm)
      throw Error(self.world->file + ": the projector's place is unknown; write it in the model");
    dot_pattern::Geometry geometry;
    geometry.nominal = geometry.actual = context.camera;
    geometry.second_view_mm = *context.projector_xyz_mm;
    geometry.range_mm = self.range_mm;
    geometry.reference_distance_mm = context.reference_distance_mm;
    geometry.depth_scale_mm = context.depth_scale_mm;
    geometry.seed = context.seed;
    geometry.unit_seed = context.unit_seed;
    geometry.capture_key = context.capture_key;
    self.instrument = std::make_unique<dot_pattern::Instrument>(self.model, geometry, *self.renderer);
  } else {
    self.run = std::make_unique<SensorRun>(self.model, context);
  }
}

Frame SyntheticCamera::frame() {
  Impl& self = *impl_;
  self.look(self.wanted());
  FrameInstant instant;
  instant.number = self.frame_number;
  instant.time_s = self.frame_number / self.frame_rate_hz;
  Frame frame = self.instrument ? self.instrument->frame(self.scene, instant.number, instant.since_power_on_s)
                                : self.run->frame(*self.channels, instant);
  if (!self.options.with_ir) frame.ir.release();
  frame.camera = self.request.camera;
  frame.rgb = self.channels->rgb;
  frame.X_WC = self.X_WC;
  frame.time_s = instant.time_s;
  frame.sequence = self.frame_number++;
  std::vector<ObjectPose> objects;
  for (std::size_t i = 0; i < self.world->objects.size(); ++i) {
    objects.push_back({self.scene.objects[i].obj_id, self.scene.objects[i].X_CO});
  }
  frame.ids = self.channels->instance.clone();
  const auto parts = static_cast<std::uint16_t>(objects.size());
  for (int row = 0; row < frame.ids.rows; ++row) {
    auto* id = frame.ids.ptr<std::uint16_t>(row);
    for (int col = 0; col < frame.ids.cols; ++col) {
      if (id[col] > parts) id[col] = 0;
    }
  }
  frame.objects = std::move(objects);
  return frame;
}

const RenderScene& SyntheticCamera::scene() const { return impl_->scene; }
const RenderRequest& SyntheticCamera::request() const { return impl_->request; }
const Renderer& SyntheticCamera::renderer() const { return *impl_->renderer; }
const World& SyntheticCamera::world() const { return *impl_->world; }

namespace {
class SyntheticSource final : public FrameSource {
 public:
  SyntheticSource(std::string uri, WorldProvider world, const SensorModel& model, const SyntheticOptions& options,
                  int scenes, int frames)
      : uri_(std::move(uri)), camera_(std::move(world), model, options), scenes_(scenes), frames_(frames) {}

  SourceInfo info() const override {
    SourceInfo info = camera_.info();
    info.uri = uri_;
    if (frames_ > 0) info.frames = std::int64_t{scenes_} * frames_;
    return info;
  }
  void start() override {
    if (running_) throw Error(uri_ + " is started already");
    running_ = true;
    taken_ = 0;
  }
  std::optional<Frame> next(std::chrono::milliseconds) override {
    if (!running_) throw Error(uri_ + " is not started");
    if (frames_ > 0 && taken_ >= std::int64_t{scenes_} * frames_) return std::nullopt;
    if (taken_ == 0 || (frames_ > 0 && taken_ % frames_ == 0)) {
      camera_.begin_scene(frames_ > 0 ? static_cast<int>(taken_ / frames_) : 0, frames_ > 0 ? frames_ : 1'000'000'000);
    }
    Frame frame = camera_.frame();
    frame.sequence = taken_++;
    frame.time_s = static_cast<double>(frame.sequence) / *camera_.info().sensor.frame_rate_hz;
    return frame;
  }
  void stop() override { running_ = false; }

 private:
  std::string uri_;
  SyntheticCamera camera_;
  int scenes_, frames_;
  bool running_ = false;
  std::int64_t taken_ = 0;
};
}  // namespace

std::unique_ptr<FrameSource> make_synthetic_source(const std::string& uri, WorldProvider world,
                                                   const SensorModel& model, const SyntheticOptions& options,
                                                   int scenes, int frames) {
  return std::make_unique<SyntheticSource>(uri, std::move(world), model, options, scenes, frames);
}

}  // namespace binrig
