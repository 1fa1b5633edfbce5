#include "bench/support/campaign.h"

#include <cmath>
#include <filesystem>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/random.h"
#include "core/recording_writer.h"
#include "sim/part_models.h"

namespace binrig::bench {
namespace {

constexpr double degree = std::numbers::pi / 180;

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

void write_models(const std::vector<CampaignModel>& models, const std::string& set) {
  std::filesystem::create_directories(set + "/models");
  nlohmann::json info;
  for (std::size_t i = 0; i < models.size(); ++i) {
    const CampaignModel& model = models[i];
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

}  // namespace

template <typename Make>
int Campaign::add(Make make, const Surface& s) {
  models_.push_back({make(s), s});
  return static_cast<int>(models_.size());
}

Campaign::Campaign(std::uint64_t seed) : seed_(seed) {
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
}

CampaignCapture& Campaign::capture(const char* split, const char* name, std::vector<PlacedModel> objects, int frames,
                                   TargetKind kind) {
  CampaignCapture c;
  c.info.split = split;
  c.info.id = 1;
  for (const CampaignCapture& other : captures_) c.info.id += other.info.split == split;
  c.info.name = name;
  c.info.target = kind;
  c.info.frames = frames;
  c.objects = std::move(objects);
  captures_.push_back(std::move(c));
  return captures_.back();
}

CampaignCapture& Campaign::plane(const char* split, const char* name, int frames, double z, double rx, double ry) {
  return capture(split, name, {{board_, pose(0, 0, z, rx, ry)}}, frames, TargetKind::plane);
}

CampaignCapture& Campaign::warm_up(const char* split, const char* name, int frames, double z, double frame_interval_s) {
  CampaignCapture& series = plane(split, name, frames, z);
  series.info.power_on = true;
  series.frame_interval_s = frame_interval_s;
  return series;
}

std::vector<PlacedModel> Campaign::step(double x, double y, double z, double turn) const {
  return {{board_, pose(0, 0, z)}, {step_, pose(x, y, z - 45, 0, 0, turn)}};
}

std::vector<PlacedModel> Campaign::ball(double x, double y, double z) const {
  return {{board_, pose(0, 0, z + 70)}, {ball_, pose(x, y, z)}};
}

std::vector<PlacedModel> Campaign::groove(double z, double angle, double turn) const {
  const double c = 130 * std::cos(angle), s = 130 * std::sin(angle);
  const Pose whole = pose(0, 0, z, 0, 0, turn);
  return {{panel_, whole * pose(-c, 0, -s, 0, -angle)}, {panel_, whole * pose(c, 0, -s, 0, angle)}};
}

std::vector<PlacedModel> Campaign::chart(double z) const {
  std::vector<PlacedModel> objects;
  for (int i = 0; i < 12; ++i) objects.push_back({tiles_[i], pose(60 * (i % 4) - 90, 60 * (i / 4) - 60, z)});
  return objects;
}

std::vector<PlacedModel> Campaign::bin(std::uint64_t which) const {
  const double floor = 860;
  std::vector<PlacedModel> objects{{board_, pose(0, 0, floor)}};
  for (double side : {-1.0, 1.0}) {
    objects.push_back({wall_, pose(side * 86, 0, floor - 35)});
    objects.push_back({wall_, pose(0, side * 66, floor - 35, 0, 0, 90 * degree)});
  }
  const RandomStream draws = RandomStream(seed_).child("bin").child(which);
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

void write_nominal(const std::string& path, const SetInfo& info, const Camera& camera, double depth_scale_mm,
                   const std::vector<CampaignModel>& models, const std::vector<CampaignCapture>& captures) {
  RecordingWriter writer(path, info);
  for (const CampaignCapture& capture : captures) {
    writer.begin_capture(capture.info);
    for (int i = 0; i < capture.info.frames; ++i) {
      Frame frame;
      frame.camera = camera;
      frame.depth_scale_mm = depth_scale_mm;
      frame.depth_mm = cv::Mat::zeros(camera.height, camera.width, CV_32F);
      frame.reason = cv::Mat(camera.height, camera.width, CV_8U, cv::Scalar(static_cast<int>(Reason::unknown)));
      frame.time_s = i * capture.frame_interval_s;
      frame.sequence = i;
      frame.objects.emplace();
      for (const PlacedModel& p : capture.objects) {
        frame.objects->push_back({p.obj_id, p.X_CO});
        frame.objects->back().X_CO.translation() += *frame.time_s * capture.velocity_mm_s;
      }
      writer.write(frame);
    }
    writer.finish_capture();
  }
  write_models(models, path);
}

SetInfo campaign_sensor() {
  SetInfo info;
  info.sensor.principle = "active stereo";
  info.sensor.baseline_mm = 100;
  info.sensor.projector_xyz_mm = Vector3(100, 0, 0);
  info.sensor.range_mm = std::array<double, 2>{700, 900};
  info.sensor.frame_rate_hz = 3;
  info.pose_sigma_mm = 0.15;
  info.pose_sigma_rad = 3e-4;
  info.cam_K_sigma_px = std::array<double, 3>{0.25, 0.05, 0.05};
  return info;
}

}  // namespace binrig::bench
