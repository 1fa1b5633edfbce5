#include "core/recording_files.h"

#include <cmath>

#include <fmt/format.h>

#include "core/error.h"

namespace binrig::recording_files {

using nlohmann::json;

std::string six_digits(int number) { return fmt::format("{:06d}", number); }

std::string image_path(const std::string& capture_folder, const std::string& kind, int frame_id) {
  return capture_folder + "/" + kind + "/" + six_digits(frame_id) + ".png";
}

std::string mask_path(const std::string& capture_folder, const std::string& kind, int frame_id, int index) {
  return capture_folder + "/" + kind + "/" + six_digits(frame_id) + "_" + six_digits(index) + ".png";
}

namespace {

json rows_of(const Eigen::Matrix3d& m) {
  json rows = json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) rows.push_back(m(r, c));
  }
  return rows;
}

json vector_of(const Vector3& v) { return json::array({v.x(), v.y(), v.z()}); }

// Numbers of a JSON list of exactly `count` finite numbers; false otherwise.
bool numbers_of(const json& entry, const char* key, std::size_t count, double* out) {
  const auto found = entry.find(key);
  if (found == entry.end() || !found->is_array() || found->size() != count) return false;
  for (std::size_t i = 0; i < count; ++i) {
    if (!(*found)[i].is_number()) return false;
    out[i] = (*found)[i].get<double>();
    if (!std::isfinite(out[i])) return false;
  }
  return true;
}

Pose read_pose(const json& entry, const char* rotation_key, const char* translation_key, const std::string& where) {
  double rotation[9], translation[3];
  if (!numbers_of(entry, rotation_key, 9, rotation) || !numbers_of(entry, translation_key, 3, translation)) {
    throw Error("a pose is not readable",
                {{where, std::string(rotation_key) + ", " + translation_key, "", "", "", "must be 9 and 3 numbers"}});
  }
  try {
    return pose_from_rows(rotation, translation);
  } catch (const Error& problem) {
    throw Error("a pose is not readable", {{where, rotation_key, "", "", "", problem.what()}});
  }
}

}  // namespace

json camera_entry(const Frame& frame, double depth_scale_mm) {
  const Camera& c = frame.camera;
  json entry;
  entry["cam_K"] = {c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0};
  entry["depth_scale"] = depth_scale_mm;
  if (c.distorted()) entry["cam_dist"] = c.distortion;
  if (frame.X_WC) {
    const Pose X_CW = frame.X_WC->inverse();
    entry["cam_R_w2c"] = rows_of(X_CW.linear());
    entry["cam_t_w2c"] = vector_of(X_CW.translation());
  }
  if (frame.time_s) entry["time_s"] = *frame.time_s;
  if (frame.host_time_s) entry["host_time_s"] = *frame.host_time_s;
  entry["seq"] = frame.sequence;
  if (frame.status != FrameStatus::complete) {
    entry["status"] = status_name(frame.status);
    entry["missing_share"] = frame.missing_share;
  }
  return entry;
}

void read_camera_entry(const json& entry, const Camera& fallback, double fallback_scale_mm,
                       const std::optional<double>& frame_rate_hz, const std::string& where, Frame& frame) {
  Violations violations;
  Camera camera = fallback;
  double k[9];
  if (entry.contains("cam_K")) {
    if (numbers_of(entry, "cam_K", 9, k)) {
      camera.fx = k[0];
      camera.cx = k[2];
      camera.fy = k[4];
      camera.cy = k[5];
    } else {
      violations.add({where, "cam_K", entry["cam_K"].dump(), "px", "nine numbers, row by row", "is not readable"});
    }
  } else if (fallback.fx <= 0) {
    violations.add(where, "cam_K", "is missing, and camera.json has none either");
  }
  if (violations.empty() && (camera.fx <= 0 || camera.fy <= 0)) {
    violations.add({where, "cam_K", entry.contains("cam_K") ? entry["cam_K"].dump() : "", "px", "", "has no positive focal length"});
  }
  camera.distortion.fill(0);
  if (const auto dist = entry.find("cam_dist"); dist != entry.end()) {
    if (dist->is_array() && dist->size() <= 8 && numbers_of(entry, "cam_dist", dist->size(), camera.distortion.data())) {
    } else {
      violations.add(where, "cam_dist", "must be at most 8 numbers: k1 k2 p1 p2 k3 k4 k5 k6");
    }
  }
  double scale = fallback_scale_mm;
  if (const auto found = entry.find("depth_scale"); found != entry.end()) {
    scale = found->is_number() ? found->get<double>() : std::nan("");
  }
  if (!(scale > 0) || !std::isfinite(scale)) {
    violations.add({where, "depth_scale", number_text(scale), "mm per count", "", "must be a positive number"});
  }
  auto optional_number = [&](const char* key) -> std::optional<double> {
    const auto found = entry.find(key);
    if (found == entry.end()) return std::nullopt;
    if (!found->is_number() || !std::isfinite(found->get<double>())) {
      violations.add(where, key, "is not a number");
      return std::nullopt;
    }
    return found->get<double>();
  };
  frame.time_s = optional_number("time_s");
  frame.host_time_s = optional_number("host_time_s");
  if (const auto sequence = optional_number("seq")) {
    frame.sequence = static_cast<std::int64_t>(*sequence);
    if (!frame.time_s && frame_rate_hz) frame.time_s = *sequence / *frame_rate_hz;
  }
  if (const auto status = entry.find("status"); status != entry.end() && status->is_string()) {
    const auto known = status_from_name(status->get<std::string>());
    if (known) frame.status = *known;
    else violations.add({where, "status", status->get<std::string>(), "", "complete, incomplete, timeout, device_lost", ""});
    frame.missing_share = optional_number("missing_share").value_or(0);
  }
  violations.throw_if_any("scene_camera.json is not usable");
  if (entry.contains("cam_R_w2c")) frame.X_WC = read_pose(entry, "cam_R_w2c", "cam_t_w2c", where).inverse();
  frame.camera = camera;
  frame.depth_scale_mm = scale;
}

json objects_entry(const std::vector<ObjectPose>& objects) {
  json list = json::array();
  for (const ObjectPose& object : objects) {
    list.push_back({{"obj_id", object.obj_id},
                    {"cam_R_m2c", rows_of(object.X_CO.linear())},
                    {"cam_t_m2c", vector_of(object.X_CO.translation())}});
  }
  return list;
}

std::vector<ObjectPose> read_objects_entry(const json& entry, const std::string& where) {
  if (!entry.is_array()) throw Error("scene_gt.json is not usable", {{where, "", "", "", "", "must be a list of objects"}});
  std::vector<ObjectPose> objects;
  for (const json& item : entry) {
    ObjectPose object;
    if (!item.contains("obj_id") || !item["obj_id"].is_number_integer()) {
      throw Error("scene_gt.json is not usable", {{where, "obj_id", "", "", "", "is missing"}});
    }
    object.obj_id = item["obj_id"].get<int>();
    object.X_CO = read_pose(item, "cam_R_m2c", "cam_t_m2c", where);
    objects.push_back(object);
  }
  return objects;
}

json sensor_entry(const SensorInfo& sensor) {
  json entry = json::object();
  if (!sensor.name.empty()) entry["name"] = sensor.name;
  if (!sensor.principle.empty()) entry["principle"] = sensor.principle;
  if (!sensor.serial.empty()) entry["serial"] = sensor.serial;
  if (sensor.baseline_mm) entry["baseline_mm"] = *sensor.baseline_mm;
  if (sensor.projector_xyz_mm) entry["projector_xyz_mm"] = vector_of(*sensor.projector_xyz_mm);
  if (sensor.range_mm) entry["range_mm"] = *sensor.range_mm;
  if (sensor.frame_rate_hz) entry["frame_rate_hz"] = *sensor.frame_rate_hz;
  if (sensor.ir_full_scale) entry["ir_full_scale"] = *sensor.ir_full_scale;
  return entry;
}

}  // namespace binrig::recording_files
