#include "core/recording_set.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/recording_files.h"

namespace binrig {

namespace fs = std::filesystem;
using nlohmann::json;
using namespace recording_files;

namespace {

json read_json(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw Error("cannot read " + path);
  try {
    return json::parse(file);
  } catch (const json::exception& problem) {
    throw Error("not JSON", {{path, "", "", "", "", problem.what()}});
  }
}

// Calls entry(key, value) for every member of the JSON object in a file without holding the whole of it.
void for_each_member(const std::string& path, const std::function<void(const std::string&, const json&)>& entry) {
  std::ifstream file(path);
  if (!file) throw Error("cannot read " + path);
  std::string key;
  auto callback = [&](int depth, json::parse_event_t event, json& parsed) {
    if (depth == 1 && event == json::parse_event_t::key) key = parsed.get<std::string>();
    const bool ended = event == json::parse_event_t::object_end || event == json::parse_event_t::array_end;
    if (depth == 1 && ended) {
      entry(key, parsed);
      return false;
    }
    return true;
  };
  try {
    const json whole = json::parse(file, callback);
  } catch (const json::exception& problem) {
    throw Error("not JSON", {{path, "", "", "", "", problem.what()}});
  }
}

// Whole PNGs only: a file cut short has no closing IEND chunk, whatever a decoder makes of it.
cv::Mat read_png(const std::string& path, int flags) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) throw Error("a recorded image is missing", {{path, "", "", "", "", "is not there or not readable"}});
  std::vector<char> bytes(static_cast<std::size_t>(file.tellg()));
  file.seekg(0);
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  const bool png = path.size() > 4 && path.compare(path.size() - 4, 4, ".png") == 0;
  constexpr char iend[] = {'I', 'E', 'N', 'D'};
  if (png && (bytes.size() < 57 || !std::equal(iend, iend + 4, bytes.end() - 8))) {
    throw Error("a recorded image is broken",
                {{path, "", "", "", "", fmt::format("is truncated ({} bytes, no closing chunk)", bytes.size())}});
  }
  const cv::Mat image = cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8U, bytes.data()), flags);
  if (image.empty()) throw Error("a recorded image is broken", {{path, "", "", "", "", "cannot be decoded"}});
  return image;
}

void check_size(const cv::Mat& image, const Camera& camera, const std::string& path) {
  if (image.cols == camera.width && image.rows == camera.height) return;
  throw Error("a recorded image is broken",
              {{path, "", fmt::format("{} x {}", image.cols, image.rows), "px",
                fmt::format("{} x {}", camera.width, camera.height), "has the wrong size"}});
}

double number_or(const json& object, const char* key, double fallback) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : fallback;
}

std::optional<double> optional_number(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number()) return std::nullopt;
  return found->get<double>();
}

std::string text_or_empty(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

template <std::size_t N>
std::optional<std::array<double, N>> optional_numbers(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_array() || found->size() != N) return std::nullopt;
  std::array<double, N> values;
  for (std::size_t i = 0; i < N; ++i) {
    if (!(*found)[i].is_number()) return std::nullopt;
    values[i] = (*found)[i].get<double>();
  }
  return values;
}

SensorInfo read_sensor(const json& entry) {
  SensorInfo sensor;
  sensor.name = text_or_empty(entry, "name");
  sensor.principle = text_or_empty(entry, "principle");
  sensor.serial = text_or_empty(entry, "serial");
  sensor.baseline_mm = optional_number(entry, "baseline_mm");
  sensor.frame_rate_hz = optional_number(entry, "frame_rate_hz");
  sensor.ir_full_scale = optional_number(entry, "ir_full_scale");
  sensor.range_mm = optional_numbers<2>(entry, "range_mm");
  if (const auto p = optional_numbers<3>(entry, "projector_xyz_mm")) sensor.projector_xyz_mm = Vector3((*p)[0], (*p)[1], (*p)[2]);
  return sensor;
}

bool all_digits(const std::string& text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c); });
}

// Frame ids of the PNGs in a folder ("000003.png" -> 3), without masks ("000003_000000.png").
void collect_ids(const fs::path& folder, std::vector<int>& ids) {
  std::error_code ignored;
  for (const auto& file : fs::directory_iterator(folder, ignored)) {
    if (file.path().extension() == ".png" && all_digits(file.path().stem().string())) {
      ids.push_back(std::stoi(file.path().stem().string()));
    }
  }
  std::sort(ids.begin(), ids.end());
}

std::vector<CaptureInfo> captures_by_folders(const std::string& set) {
  std::vector<CaptureInfo> captures;
  for (const auto& split : fs::directory_iterator(set)) {
    if (!split.is_directory() || split.path().filename().string().rfind("models", 0) == 0) continue;
    for (const auto& scene : fs::directory_iterator(split.path())) {
      if (!all_digits(scene.path().filename().string()) || !fs::exists(scene.path() / "scene_camera.json")) continue;
      CaptureInfo capture;
      capture.split = split.path().filename().string();
      capture.id = std::stoi(scene.path().filename().string());
      capture.name = capture.split + " " + std::to_string(capture.id);
      captures.push_back(capture);
    }
  }
  std::sort(captures.begin(), captures.end(),
            [](const CaptureInfo& a, const CaptureInfo& b) { return std::tie(a.split, a.id) < std::tie(b.split, b.id); });
  return captures;
}

}  // namespace

std::string CaptureInfo::folder() const { return split + "/" + six_digits(id); }

// ------------------------------------------------------------------------------------------------ captures

struct CaptureReader::Data {
  CaptureInfo info;
  std::string folder;  // SET/train/000001
  std::map<int, Reason> reason_of_value;
  bool has_depth = true;
  int mask_count = 0;  // masks a frame can have

  // Compact, because a capture may have many thousand frames: cameras and poses repeat and are kept once.
  struct Entry {
    int id = 0;
    int header = -1;   // index into headers
    int objects = -1;  // index into object_lists; -1 = unknown
    double time_s = NAN, host_time_s = NAN;
    std::int64_t sequence = 0;
    int problem = -1;  // index into problems: why the header could not be read
  };
  std::vector<Entry> entries;  // by id
  std::vector<std::string> problems;

  Entry* find(int id) {
    const auto place = std::lower_bound(entries.begin(), entries.end(), id, [](const Entry& e, int i) { return e.id < i; });
    return place != entries.end() && place->id == id ? &*place : nullptr;
  }
  /// The entry of a frame, made where it is not there yet; ids mostly come in order.
  Entry& at(int id) {
    const auto place = std::lower_bound(entries.begin(), entries.end(), id, [](const Entry& e, int i) { return e.id < i; });
    if (place != entries.end() && place->id == id) return *place;
    Entry entry;
    entry.id = id;
    return *entries.insert(place, entry);
  }
  void fail(Entry& entry, const std::string& why) {
    entry.problem = static_cast<int>(problems.size());
    problems.push_back(why);
  }

  std::vector<Frame> headers;  // without images, times and objects
  std::vector<std::vector<ObjectPose>> object_lists;
};

namespace {

bool same_header(const Frame& a, const Frame& b) {
  const bool poses = a.X_WC.has_value() == b.X_WC.has_value() && (!a.X_WC || a.X_WC->matrix() == b.X_WC->matrix());
  return poses && a.camera == b.camera && a.depth_scale_mm == b.depth_scale_mm && a.status == b.status &&
         a.missing_share == b.missing_share;
}

bool same_objects(const std::vector<ObjectPose>& a, const std::vector<ObjectPose>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const ObjectPose& p, const ObjectPose& q) {
    return p.obj_id == q.obj_id && p.X_CO.matrix() == q.X_CO.matrix();
  });
}

}  // namespace

const CaptureInfo& CaptureReader::info() const { return data_->info; }
int CaptureReader::size() const { return static_cast<int>(data_->entries.size()); }
int CaptureReader::frame_id(int i) const { return data_->entries.at(i).id; }
bool CaptureReader::has_depth() const { return data_->has_depth; }

Frame CaptureReader::header(int i) const {
  const Data::Entry& entry = data_->entries.at(i);
  if (entry.problem >= 0) throw Error(data_->problems[entry.problem]);
  Frame frame = data_->headers.at(entry.header);
  if (!std::isnan(entry.time_s)) frame.time_s = entry.time_s;
  if (!std::isnan(entry.host_time_s)) frame.host_time_s = entry.host_time_s;
  frame.sequence = entry.sequence;
  if (entry.objects >= 0) frame.objects = data_->object_lists[entry.objects];
  return frame;
}

Frame CaptureReader::frame(int i) const {
  Frame frame = header(i);
  const std::string& folder = data_->folder;
  const int id = frame_id(i);
  const bool silent = frame.status == FrameStatus::timeout || frame.status == FrameStatus::device_lost;
  const std::string depth_path = image_path(folder, "depth", id);
  if (silent && !fs::exists(depth_path)) return frame;

  if (data_->has_depth) {
    const cv::Mat counts = read_png(depth_path, cv::IMREAD_UNCHANGED);
    if (counts.type() != CV_16U) {
      throw Error("a recorded image is broken", {{depth_path, "", cv::typeToString(counts.type()), "",
                                                  "one channel of 16 bits", "is no depth image"}});
    }
    if (frame.camera.width == 0) {
      frame.camera.width = counts.cols;
      frame.camera.height = counts.rows;
    }
    check_size(counts, frame.camera, depth_path);
    frame.depth_mm.create(counts.size(), CV_32F);
    frame.reason.create(counts.size(), CV_8U);
    const std::string reason_path = image_path(folder, "reason", id);
    cv::Mat reasons;
    if (fs::exists(reason_path)) {
      reasons = read_png(reason_path, cv::IMREAD_UNCHANGED);
      check_size(reasons, frame.camera, reason_path);
      if (reasons.type() != CV_8U) throw Error("a recorded image is broken", {{reason_path, "", "", "", "", "is not 8-bit"}});
    }
    std::array<std::uint8_t, 256> lookup;
    lookup.fill(static_cast<std::uint8_t>(Reason::unknown));
    for (const auto& [value, reason] : data_->reason_of_value) lookup[value] = static_cast<std::uint8_t>(reason);
    lookup[0] = static_cast<std::uint8_t>(Reason::unknown);
    for (int row = 0; row < counts.rows; ++row) {
      const std::uint16_t* in = counts.ptr<std::uint16_t>(row);
      const std::uint8_t* why = reasons.empty() ? nullptr : reasons.ptr<std::uint8_t>(row);
      float* depth = frame.depth_mm.ptr<float>(row);
      std::uint8_t* out = frame.reason.ptr<std::uint8_t>(row);
      for (int col = 0; col < counts.cols; ++col) {
        depth[col] = static_cast<float>(in[col] * frame.depth_scale_mm);
        out[col] = in[col] > 0 ? 0 : lookup[why ? why[col] : 0];
      }
    }
  }
  if (const std::string path = image_path(folder, "gray", id); fs::exists(path)) {
    frame.ir = read_png(path, cv::IMREAD_UNCHANGED);
    if (frame.camera.width == 0) {
      frame.camera.width = frame.ir.cols;
      frame.camera.height = frame.ir.rows;
    }
    check_size(frame.ir, frame.camera, path);
    if (frame.ir.type() != CV_16U && frame.ir.type() != CV_8U) {
      throw Error("a recorded image is broken", {{path, "", cv::typeToString(frame.ir.type()), "", "8 or 16 bits, one channel", ""}});
    }
  }
  if (const std::string path = image_path(folder, "rgb", id); fs::exists(path)) {
    cv::cvtColor(read_png(path, cv::IMREAD_COLOR), frame.rgb, cv::COLOR_BGR2RGB);
    check_size(frame.rgb, frame.camera, path);
  }
  for (int k = 0; k < data_->mask_count; ++k) {
    const std::string path = mask_path(folder, "mask_visib", id, k);
    if (!fs::exists(path)) continue;
    const cv::Mat mask = read_png(path, cv::IMREAD_GRAYSCALE);
    check_size(mask, frame.camera, path);
    if (frame.ids.empty()) frame.ids = cv::Mat::zeros(mask.size(), CV_16U);
    frame.ids.setTo(k + 1, mask);
  }
  return frame;
}

cv::Mat marked_region(const Frame& frame, bool region_masks) {
  if (!region_masks || frame.ids.empty()) return {};
  cv::Mat region = frame.ids > 0;
  if (cv::countNonZero(region) == 0) return {};
  cv::erode(region, region, cv::Mat::ones(5, 5, CV_8U), {-1, -1}, 1, cv::BORDER_CONSTANT, 255);
  return region;
}

// ----------------------------------------------------------------------------------------------------- set

RecordingSet RecordingSet::open(const std::string& path) {
  if (!fs::is_directory(path)) throw Error(path + " is no recording set: not a directory");
  auto info = std::make_shared<SetInfo>();
  info->path = path;
  Violations violations;
  const std::string recording_json = path + "/recording.json";
  if (fs::exists(recording_json)) {
    const json recording = read_json(recording_json);
    if (!recording.is_object()) throw Error("not a recording set", {{recording_json, "", "", "", "", "must be a JSON object"}});
    if (recording.contains("sensor") && recording["sensor"].is_object()) info->sensor = read_sensor(recording["sensor"]);
    info->pose_sigma_mm = optional_number(recording, "pose_sigma_mm");
    info->pose_sigma_rad = optional_number(recording, "pose_sigma_rad");
    info->cam_K_sigma_px = optional_numbers<3>(recording, "cam_K_sigma_px");
    const auto fitted = recording.find("poses_fitted_to_this_depth");
    info->poses_fitted_to_this_depth = fitted != recording.end() && fitted->is_boolean() && fitted->get<bool>();
    info->region_masks = recording.contains("region");
    if (const std::string file = text_or_empty(recording, "valid_region"); !file.empty()) {
      info->valid_region = read_png(path + "/" + file, cv::IMREAD_GRAYSCALE);
    }
    if (const auto list = recording.find("captures"); list != recording.end() && list->is_array()) {
      for (std::size_t i = 0; i < list->size(); ++i) {
        const json& item = (*list)[i];
        CaptureInfo capture;
        capture.split = text_or_empty(item, "split");
        capture.id = static_cast<int>(number_or(item, "id", -1));
        capture.name = text_or_empty(item, "name");
        capture.target = text_or_empty(item, "target") == "plane" ? TargetKind::plane : TargetKind::scene;
        capture.frames = static_cast<int>(number_or(item, "frames", 0));
        capture.power_on = item.contains("power_on") && item["power_on"].is_boolean() && item["power_on"].get<bool>();
        if (capture.split.empty() || capture.id < 0) {
          violations.add(recording_json, fmt::format("captures[{}]", i), "needs split and id");
        } else if (!fs::is_directory(path + "/" + capture.folder())) {
          violations.add(recording_json, fmt::format("captures[{}]", i), "its folder " + capture.folder() + " is missing");
        }
        info->captures.push_back(capture);
      }
    }
  }
  if (info->captures.empty()) info->captures = captures_by_folders(path);
  violations.throw_if_any(path + " is not a usable recording set");
  if (info->captures.empty()) {
    throw Error(path + " is no recording set: it has neither recording.json with captures nor folders with scene_camera.json");
  }

  RecordingSet set;
  set.info_ = info;
  const std::string models_info = path + "/models/models_info.json";
  if (fs::exists(models_info)) {
    const json models = read_json(models_info);
    for (const auto& [key, value] : models.items()) {
      if (!all_digits(key) || !value.is_object()) {
        throw Error("models_info.json is not usable", {{models_info, key, "", "", "", "must be an object id with its properties"}});
      }
      ModelInfo model;
      model.obj_id = std::stoi(key);
      model.mesh_path = path + "/models/obj_" + six_digits(model.obj_id) + ".ply";
      model.diameter_mm = number_or(value, "diameter", 0);
      model.albedo = optional_number(value, "albedo");
      model.specular = optional_number(value, "specular");
      model.shininess = optional_number(value, "shininess");
      set.models_.push_back(model);
    }
  }
  return set;
}

CaptureReader RecordingSet::capture(const std::string& split, int id) const {
  const auto found = std::find_if(captures().begin(), captures().end(),
                                  [&](const CaptureInfo& c) { return c.split == split && c.id == id; });
  if (found == captures().end()) {
    std::string list;
    for (const CaptureInfo& capture : captures()) list += (list.empty() ? "" : ", ") + capture.key();
    throw Error(fmt::format("{} has no capture {}/{} (it has {})", info_->path, split, id, list));
  }
  auto data = std::make_shared<CaptureReader::Data>();
  data->info = *found;
  data->folder = info_->path + "/" + found->folder();
  const std::string recording_json = info_->path + "/recording.json";
  if (fs::exists(recording_json)) {
    const json recording = read_json(recording_json);
    if (const auto names = recording.find("reasons"); names != recording.end() && names->is_object()) {
      for (const auto& [value, name] : names->items()) {
        if (!all_digits(value) || !name.is_string()) continue;
        const int number = std::stoi(value);
        if (number > 0 && number < 256) {
          data->reason_of_value[number] = reason_from_name(name.get<std::string>()).value_or(Reason::unknown);
        }
      }
    }
  }

  Camera fallback;
  double fallback_scale = 0;
  if (const std::string path = info_->path + "/camera.json"; fs::exists(path)) {
    const json camera = read_json(path);
    fallback.fx = number_or(camera, "fx", 0);
    fallback.fy = number_or(camera, "fy", fallback.fx);
    fallback.cx = number_or(camera, "cx", 0);
    fallback.cy = number_or(camera, "cy", 0);
    fallback.width = static_cast<int>(number_or(camera, "width", 0));
    fallback.height = static_cast<int>(number_or(camera, "height", 0));
    fallback_scale = number_or(camera, "depth_scale", 0);
  }

  auto add_camera = [&](int frame_id, const json& value, const std::string& where) {
    CaptureReader::Data::Entry& entry = data->at(frame_id);
    entry.sequence = frame_id;
    try {
      Frame header;
      header.sequence = frame_id;
      read_camera_entry(value, fallback, fallback_scale, info_->sensor.frame_rate_hz, where, header);
      entry.time_s = header.time_s.value_or(NAN);
      entry.host_time_s = header.host_time_s.value_or(NAN);
      entry.sequence = header.sequence;
      header.time_s.reset();
      header.host_time_s.reset();
      header.sequence = 0;
      if (data->headers.empty() || !same_header(data->headers.back(), header)) data->headers.push_back(header);
      entry.header = static_cast<int>(data->headers.size()) - 1;
    } catch (const Error& problem) {
      data->fail(entry, problem.what());
    }
  };
  auto add_objects = [&](int frame_id, const json& value, const std::string& where) {
    CaptureReader::Data::Entry* entry = data->find(frame_id);
    if (!entry) return;
    try {
      std::vector<ObjectPose> objects = read_objects_entry(value, where);
      if (data->object_lists.empty() || !same_objects(data->object_lists.back(), objects)) data->object_lists.push_back(objects);
      entry->objects = static_cast<int>(data->object_lists.size()) - 1;
    } catch (const Error& problem) {
      data->fail(*entry, problem.what());
    }
  };

  const std::string cameras = data->folder + "/scene_camera.json", poses = data->folder + "/scene_gt.json";
  const std::string journal = data->folder + "/" + journal_name;
  if (!fs::exists(cameras) && !fs::exists(journal)) throw Error("a capture is broken", {{cameras, "", "", "", "", "is missing"}});
  auto where = [](const std::string& file, const std::string& frame) { return file + ", frame " + frame; };
  if (fs::exists(cameras)) {
    for_each_member(cameras, [&](const std::string& key, const json& value) {
      if (all_digits(key)) add_camera(std::stoi(key), value, where(cameras, key));
    });
  }
  std::vector<int> files;
  collect_ids(data->folder + "/depth", files);
  data->has_depth = fs::exists(data->folder + "/depth");
  if (files.empty()) collect_ids(data->folder + "/gray", files);
  for (int id : files) {
    if (!data->find(id) && !fs::exists(journal)) add_camera(id, json::object(), where(cameras, std::to_string(id)));
  }
  if (fs::exists(poses)) {
    for_each_member(poses, [&](const std::string& key, const json& value) {
      if (all_digits(key)) add_objects(std::stoi(key), value, where(poses, key));
    });
  }
  if (std::ifstream lines(journal); lines) {  // a recording that was cut short: the last line may be half
    for (std::string line; std::getline(lines, line);) {
      const json item = json::parse(line, nullptr, false);
      if (item.is_discarded() || !item.contains("id")) continue;
      const int id = item["id"].get<int>();
      add_camera(id, item.value("camera", json::object()), where(journal, std::to_string(id)));
      if (item.contains("gt")) add_objects(id, item["gt"], where(journal, std::to_string(id)));
    }
  }
  if (data->info.frames == 0) data->info.frames = static_cast<int>(data->entries.size());

  std::error_code ignored;
  for (const auto& file : fs::directory_iterator(data->folder + "/mask_visib", ignored)) {
    const std::string stem = file.path().stem().string();
    if (stem.size() == 13 && stem[6] == '_' && all_digits(stem.substr(7))) {
      data->mask_count = std::max(data->mask_count, std::stoi(stem.substr(7)) + 1);
    }
  }
  CaptureReader reader;
  reader.data_ = data;
  return reader;
}

cv::Mat RecordingSet::region(const CaptureInfo& info) const {
  cv::Mat region = info_->valid_region;
  if (!info_->region_masks || info.target != TargetKind::plane) return region;  // no frame needs to be read
  const CaptureReader reader = capture(info.key());
  for (int i = 0; i < reader.size(); ++i) {
    cv::Mat marked;
    try {
      marked = marked_region(reader.frame(i), info_->region_masks);
    } catch (const Error&) {
      continue;
    }
    if (!marked.empty()) region = region.empty() ? marked : cv::Mat(region & marked);
  }
  return region;
}

CaptureReader RecordingSet::capture(const std::string& key) const {
  const std::size_t slash = key.find('/');
  if (slash == std::string::npos || !all_digits(key.substr(slash + 1))) {
    throw Error("a capture is named SPLIT/ID, for example train/1, not '" + key + "'");
  }
  return capture(key.substr(0, slash), std::stoi(key.substr(slash + 1)));
}

}  // namespace binrig
