// Writes fixtures/recorded: campaigns "recorded" by sensors whose truth is documented (fixtures/recorded/README.md).
//
//   make_fixtures OUT SENSORS
//
// OUT must not exist. Poses in the files are nominal; every capture's targets really stood elsewhere, within
// pose_sigma.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/random.h"
#include "core/recording_writer.h"
#include "sim/effect.h"
#include "sim/part_models.h"
#include "sim/scene_forward_model.h"

namespace binrig {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t seed = 20241121;
constexpr double degree = std::numbers::pi / 180;
constexpr double pose_sigma_mm = 0.15, pose_sigma_rad = 3e-4;

struct Model {
  std::shared_ptr<const Mesh> mesh;
  Surface surface;
};

struct Placed {
  int obj_id;
  Pose X_CO;
};

struct Capture {
  CaptureInfo info;
  std::vector<Placed> objects;
  double frame_interval_s = 1.0 / 3;
};

Surface surface(float albedo, float specular = 0, float shininess = 30) {
  Surface result;
  result.albedo = albedo, result.specular = specular, result.shininess = shininess;
  return result;
}

Pose pose(double x, double y, double z, double rx = 0, double ry = 0, double rz = 0) {
  Pose X = Pose::Identity();
  X.translation() = Vector3(x, y, z);
  X.linear() = (Eigen::AngleAxisd(rx, Vector3::UnitX()) * Eigen::AngleAxisd(ry, Vector3::UnitY()) *
                Eigen::AngleAxisd(rz, Vector3::UnitZ()))
                   .toRotationMatrix();
  return X;
}

void write_ply(const Mesh& mesh, const std::string& path) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
  for (const auto& v : mesh.vertices) bytes.append(reinterpret_cast<const char*>(v.data()), 12);
  for (const auto& t : mesh.triangles) {
    bytes.push_back(3);
    bytes.append(reinterpret_cast<const char*>(t.data()), 12);
  }
  write_file_atomically(path, bytes);
}

void write_models(const std::vector<Model>& models, const std::string& set) {
  fs::create_directories(set + "/models");
  nlohmann::json info;
  for (std::size_t i = 0; i < models.size(); ++i) {
    const Model& model = models[i];
    write_ply(*model.mesh, fmt::format("{}/models/obj_{:06d}.ply", set, i + 1));
    Eigen::Vector3f low, high;
    model.mesh->bounds(low, high);
    info[std::to_string(i + 1)] = {{"diameter", diameter_mm(*model.mesh)},
                                   {"min_x", low.x()},
                                   {"min_y", low.y()},
                                   {"min_z", low.z()},
                                   {"size_x", high.x() - low.x()},
                                   {"size_y", high.y() - low.y()},
                                   {"size_z", high.z() - low.z()},
                                   {"albedo", std::round(model.surface.albedo * 1e4) / 1e4},
                                   {"specular", std::round(model.surface.specular * 1e4) / 1e4},
                                   {"shininess", model.surface.shininess}};
  }
  write_file_atomically(set + "/models/models_info.json", info.dump(1));
}

class Campaign {
 public:
  Campaign() {
    board_ = add([](const Surface& s) { return rectangle_mesh(840, 840, s); }, surface(0.6f));
    step_ = add([](const Surface& s) { return box_mesh({90, 64, 90}, s); }, surface(0.6f));
    ball_ = add([](const Surface& s) { return sphere_mesh(58, 72, s); }, surface(0.6f));
    panel_ = add([](const Surface& s) { return rectangle_mesh(260, 420, s); }, surface(0.6f));
    for (const auto& [albedo, specular] : std::vector<std::pair<float, float>>{{0.04f, 0.f},
                                                                               {0.6f, 0.f},
                                                                               {0.15f, 0.f},
                                                                               {0.9f, 0.f},
                                                                               {0.3f, 0.f},
                                                                               {0.08f, 0.f},
                                                                               {0.5f, 0.6f},
                                                                               {0.1f, 0.6f},
                                                                               {0.75f, 0.f},
                                                                               {0.02f, 0.f},
                                                                               {0.45f, 0.f},
                                                                               {0.2f, 0.3f}}) {
      tiles_.push_back(add([](const Surface& s) { return rectangle_mesh(60, 60, s); }, surface(albedo, specular, 20)));
    }
    wall_ = add([](const Surface& s) { return box_mesh({8, 180, 70}, s); }, surface(0.45f));
    for (const char* name : {"bracket", "cylinder", "box", "wrench"}) {
      parts_.push_back(add([&](const Surface& s) { return part_model(name, s).mesh; }, surface(0.5f, 0.25f, 25)));
    }
    make_captures();
  }
  const std::vector<Model>& models() const { return models_; }
  const std::vector<Capture>& captures() const { return captures_; }

 private:
  template <typename Make>
  int add(Make make, const Surface& s) {
    models_.push_back({make(s), s});
    return static_cast<int>(models_.size());
  }
  void capture(const char* split, const char* name, std::vector<Placed> objects, TargetKind kind = TargetKind::scene,
               int frames = 0) {
    Capture c;
    c.info.split = split;
    c.info.id = 1;
    for (const Capture& other : captures_) c.info.id += other.info.split == split;
    c.info.name = name;
    c.info.target = kind;
    c.info.frames = frames ? frames : (c.info.split == "train" ? 4 : 3);
    c.objects = std::move(objects);
    captures_.push_back(std::move(c));
  }
  void plane(const char* split, const char* name, double z, double rx = 0, double ry = 0, int frames = 0) {
    capture(split, name, {{board_, pose(0, 0, z, rx, ry)}}, TargetKind::plane, frames);
  }
  std::vector<Placed> step(double x, double y, double z, double turn) const {
    return {{board_, pose(0, 0, z)}, {step_, pose(x, y, z - 45, 0, 0, turn)}};
  }
  std::vector<Placed> ball(double x, double y, double z) const {
    return {{board_, pose(0, 0, z + 70)}, {ball_, pose(x, y, z)}};
  }
  // Two panels that meet in a line `z` away, each turned by `angle` towards the camera.
  std::vector<Placed> groove(double z, double angle, double turn) const {
    const double c = 130 * std::cos(angle), s = 130 * std::sin(angle);
    const Pose whole = pose(0, 0, z, 0, 0, turn);
    return {{panel_, whole * pose(-c, 0, -s, 0, -angle)}, {panel_, whole * pose(c, 0, -s, 0, angle)}};
  }
  std::vector<Placed> chart(double z) const {
    std::vector<Placed> objects;
    for (int i = 0; i < 12; ++i) objects.push_back({tiles_[i], pose(60 * (i % 4) - 90, 60 * (i / 4) - 60, z)});
    return objects;
  }
  // Parts laid loosely into a box of four walls: nothing stands on nothing, but nobody shook it either.
  std::vector<Placed> bin(std::uint64_t which) const {
    const double floor = 860;
    std::vector<Placed> objects{{board_, pose(0, 0, floor)}};
    for (double side : {-1.0, 1.0}) {
      objects.push_back({wall_, pose(side * 86, 0, floor - 35)});
      objects.push_back({wall_, pose(0, side * 66, floor - 35, 0, 0, 90 * degree)});
    }
    const RandomStream draws = RandomStream(seed).child("bin").child(which);
    for (int i = 0; i < 9; ++i) {
      const double x = 52 * (i % 3 - 1) + 8 * (draws.uniform(8 * i) - 0.5),
                   y = 40 * (i / 3 - 1) + 8 * (draws.uniform(8 * i + 1) - 0.5);
      const int part = parts_[static_cast<std::size_t>(draws.uniform(8 * i + 2) * parts_.size())];
      Eigen::Vector3f low, high;
      models_[part - 1].mesh->bounds(low, high);
      const double lean = 25 * degree * (draws.uniform(8 * i + 3) - 0.5);
      objects.push_back({part, pose(x, y, floor - high.z() - 10, lean, 0, 360 * degree * draws.uniform(8 * i + 4))});
    }
    return objects;
  }
  void warm_up(const char* split, const char* name, double z, int frames) {
    plane(split, name, z, 0, 0, frames);
    captures_.back().info.power_on = true;
    captures_.back().frame_interval_s = 10;
  }

  void make_captures() {
    plane("train", "plane_720", 720);
    plane("train", "plane_800", 800);
    plane("train", "plane_880", 880);
    plane("train", "tilt_y34", 800, 0, 34 * degree);
    plane("train", "tilt_x40", 800, 40 * degree, 0);
    capture("train", "step", step(-12, 6, 850, 12 * degree));
    capture("train", "sphere", ball(8, -5, 790));
    capture("train", "chart", chart(800));
    capture("train", "groove", groove(850, 38 * degree, 8 * degree));
    capture("train", "bin", bin(1));
    warm_up("train", "warm_up", 800, 10);
    plane("test", "plane_750", 750);
    plane("test", "plane_850", 850);
    plane("test", "tilt_xy", 800, 22 * degree, -20 * degree);
    capture("test", "step_2", step(20, -8, 830, -25 * degree));
    capture("test", "sphere_2", ball(-20, 10, 770));
    capture("test", "groove_2", groove(830, 30 * degree, 80 * degree));
    capture("test", "bin_2", bin(2));
    warm_up("test", "warm_up_2", 760, 6);
  }

  std::vector<Model> models_;
  std::vector<Capture> captures_;
  int board_, step_, ball_, panel_, wall_;
  std::vector<int> tiles_, parts_;
};

std::vector<Capture> plane_source_captures(int board) {
  std::vector<Capture> captures;
  for (const auto& [split, id, z] : std::vector<std::tuple<const char*, int, double>>{
           {"train", 1, 740.0}, {"train", 2, 860.0}, {"test", 1, 800.0}}) {
    Capture c;
    c.info.split = split;
    c.info.id = id;
    c.info.name = fmt::format("plane_{:.0f}", z);
    c.info.target = TargetKind::plane;
    c.info.frames = 8;
    c.objects = {{board, pose(0, 0, z)}};
    captures.push_back(c);
  }
  return captures;
}

// A set that holds poses and times but no depth yet, for the forward model to fill.
void write_nominal(const std::string& path, const SetInfo& info, const Camera& camera, const std::vector<Model>& models,
                   const std::vector<Capture>& captures) {
  RecordingWriter writer(path, info);
  for (const Capture& capture : captures) {
    writer.begin_capture(capture.info);
    for (int i = 0; i < capture.info.frames; ++i) {
      Frame frame;
      frame.camera = camera;
      frame.depth_scale_mm = 0.02;
      frame.depth_mm = cv::Mat::zeros(camera.height, camera.width, CV_32F);
      frame.reason = cv::Mat(camera.height, camera.width, CV_8U, cv::Scalar(static_cast<int>(Reason::unknown)));
      frame.objects.emplace();
      for (const Placed& p : capture.objects) frame.objects->push_back({p.obj_id, p.X_CO});
      frame.time_s = i * capture.frame_interval_s;
      frame.sequence = i;
      writer.write(frame);
    }
    writer.finish_capture();
  }
  write_models(models, path);
}

// What the sensor makes of it, every capture's targets moved by its own draw from pose_sigma.
void record(const std::string& nominal_path, const SensorModel& model, const std::string& out) {
  const RecordingSet nominal = RecordingSet::open(nominal_path);
  const SceneForwardModel forward(nominal);
  RecordingWriter writer(out, nominal.info());
  for (std::size_t c = 0; c < forward.captures().size(); ++c) {
    const CaptureInfo& info = forward.captures()[c];
    SimulationRequest request;
    request.capture = static_cast<int>(c);
    request.model = &model;
    request.seed = mix_keys(seed, hash_text(model.name));
    const RandomStream draws = RandomStream(request.seed).child("poses").child(info.key());
    for (int i = 0; i < 6; ++i) request.offset.pose[i] = (i < 3 ? pose_sigma_rad : pose_sigma_mm) * draws.normal(i);
    writer.begin_capture(info);
    forward.simulate(request, [&](const Frame& frame, int) { writer.write(frame); });
    writer.finish_capture();
    std::printf("%s %s\n", out.c_str(), info.key().c_str());
  }
  writer.copy_models(nominal_path);
}

void make(const fs::path& out, const fs::path& sensors) {
  if (fs::exists(out)) throw Error(out.string() + " exists already");
  SetInfo info;
  info.sensor.name = "first-principles instrument";
  info.sensor.principle = "structured light";
  info.sensor.baseline_mm = 100;
  info.sensor.projector_xyz_mm = Vector3(100, 0, 0);
  info.sensor.range_mm = std::array<double, 2>{700, 900};
  info.sensor.frame_rate_hz = 3;
  info.pose_sigma_mm = pose_sigma_mm;
  info.pose_sigma_rad = pose_sigma_rad;
  info.cam_K_sigma_px = std::array<double, 3>{0.25, 0.05, 0.05};

  const Campaign campaign;
  const fs::path scratch = out / "nominal";
  const Camera camera = camera_from_field_of_view(160, 120, 16.06 * degree);
  write_nominal(scratch / "campaign", info, camera, campaign.models(), campaign.captures());
  for (const char* name : {"clean", "imperfect"}) {
    const SensorModel model = read_sensor_model(sensors / fmt::format("{}.yaml", name), effect_catalogue());
    record(scratch / "campaign", model, out / fmt::format("campaign-{}", name));
  }

  info.sensor.name = "planes with noise of a known spectrum";
  info.cam_K_sigma_px.reset();
  write_nominal(scratch / "planes", info, camera.resized(320, 240), {campaign.models().front()},
                plane_source_captures(1));
  record(scratch / "planes", read_sensor_model(sensors / "plane_source.yaml", effect_catalogue()),
         out / "plane-source");
  fs::remove_all(scratch);
}

}  // namespace
}  // namespace binrig

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: make_fixtures OUT SENSORS\n");
    return 2;
  }
  try {
    binrig::make(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
