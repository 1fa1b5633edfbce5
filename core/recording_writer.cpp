#include "core/recording_writer.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

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

Error write_error(const std::string& path, int code) {
  return Error("cannot write", {{path, "", "", "", "", std::strerror(code)}});
}

// Writes everything to `path` or throws and leaves nothing.
void write_whole(const std::string& path, const void* bytes, std::size_t size) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) throw write_error(path, errno);
  const char* at = static_cast<const char*>(bytes);
  int code = 0;
  for (std::size_t left = size; left > 0 && code == 0;) {
    const ssize_t written = ::write(file, at, left);
    if (written < 0) {
      if (errno != EINTR) code = errno;
      continue;
    }
    at += written;
    left -= static_cast<std::size_t>(written);
  }
  if (::close(file) != 0 && code == 0) code = errno;
  if (code != 0) {
    ::unlink(path.c_str());
    throw write_error(path, code);
  }
}

void make_folder(const std::string& path) {
  std::error_code code;
  fs::create_directories(path, code);
  if (code) throw write_error(path, code.value());
}

json capture_entry(const CaptureInfo& capture) {
  return {{"split", capture.split},
          {"id", capture.id},
          {"name", capture.name},
          {"target", capture.target == TargetKind::plane ? "plane" : "scene"},
          {"frames", capture.frames},
          {"power_on", capture.power_on}};
}

json set_entry(const SetInfo& info) {
  json entry;
  entry["sensor"] = sensor_entry(info.sensor);
  if (info.pose_sigma_mm) entry["pose_sigma_mm"] = *info.pose_sigma_mm;
  if (info.pose_sigma_rad) entry["pose_sigma_rad"] = *info.pose_sigma_rad;
  if (info.cam_K_sigma_px) entry["cam_K_sigma_px"] = *info.cam_K_sigma_px;
  if (info.poses_fitted_to_this_depth) entry["poses_fitted_to_this_depth"] = true;
  if (info.region_masks) entry["region"] = "mask_visib marks the flat target";
  if (!info.valid_region.empty()) entry["valid_region"] = "valid_region.png";
  json reasons = json::object();
  for (int i = 1; i < reason_count; ++i) reasons[std::to_string(i)] = reason_name(static_cast<Reason>(i));
  entry["reasons"] = reasons;
  json captures = json::array();
  for (const CaptureInfo& capture : info.captures) captures.push_back(capture_entry(capture));
  entry["captures"] = captures;
  return entry;
}

std::vector<unsigned char> png_bytes(const cv::Mat& image, int compression) {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, compression})) {
    throw Error("an image cannot be stored as PNG");
  }
  return bytes;
}

}  // namespace

void write_file_atomically(const std::string& path, const void* bytes, std::size_t size) {
  const std::string temporary = path + ".part";
  write_whole(temporary, bytes, size);
  if (::rename(temporary.c_str(), path.c_str()) != 0) {
    const int code = errno;
    ::unlink(temporary.c_str());
    throw write_error(path, code);
  }
}

void write_file_atomically(const std::string& path, const std::string& text) {
  write_file_atomically(path, text.data(), text.size());
}

struct RecordingWriter::Impl {
  std::string path, folder;
  SetInfo info;
  WriterOptions options;
  std::optional<CaptureInfo> open;
  Camera first_camera;
  double first_scale = 0, loss_mm = 0;

  void write_info() { write_file_atomically(path + "/recording.json", set_entry(info).dump(1)); }

  // The images of one frame as bytes, by path. Nothing is on disk before all of them are encoded.
  std::vector<std::pair<std::string, std::vector<unsigned char>>> encode(const Frame& frame, int id, double scale) {
    std::vector<std::pair<std::string, std::vector<unsigned char>>> files;
    auto add = [&](const char* kind, const cv::Mat& image) {
      files.emplace_back(image_path(folder, kind, id), png_bytes(image, options.png_compression));
    };
    if (!frame.depth_mm.empty()) {
      cv::Mat counts(frame.depth_mm.size(), CV_16U);
      bool reasons_say_more = false;
      for (int row = 0; row < counts.rows; ++row) {
        const float* in = frame.depth_mm.ptr<float>(row);
        const std::uint8_t* why = frame.reason.ptr<std::uint8_t>(row);
        std::uint16_t* out = counts.ptr<std::uint16_t>(row);
        for (int col = 0; col < counts.cols; ++col) {
          const long count = std::lround(in[col] / scale);
          if (in[col] > 0 && (count < 1 || count > 65535)) {
            throw Error("a depth does not fit the set's 16 bits",
                        {{files.empty() ? folder : files[0].first, fmt::format("depth at ({}, {})", col, row),
                          number_text(in[col]), "mm", fmt::format("{} .. {}", scale, 65535 * scale), ""}});
          }
          out[col] = static_cast<std::uint16_t>(count);
          loss_mm = std::max(loss_mm, std::abs(in[col] - count * scale));
          reasons_say_more |= why[col] != 0 && why[col] != static_cast<std::uint8_t>(Reason::unknown);
        }
      }
      add("depth", counts);
      if (options.reasons && reasons_say_more) add("reason", frame.reason);
    }
    if (!frame.ir.empty()) add("gray", frame.ir);
    if (!frame.rgb.empty()) {
      cv::Mat bgr;
      cv::cvtColor(frame.rgb, bgr, cv::COLOR_RGB2BGR);
      add("rgb", bgr);
    }
    if (options.masks && !frame.ids.empty()) {
      double largest = 0;
      cv::minMaxLoc(frame.ids, nullptr, &largest);
      const int known = frame.objects ? static_cast<int>(frame.objects->size()) : 0;
      for (int k = 0; k < std::max({1, static_cast<int>(largest), known}); ++k) {
        files.emplace_back(mask_path(folder, "mask_visib", id, k), png_bytes(frame.ids == k + 1, options.png_compression));
      }
    }
    return files;
  }
};

RecordingWriter::RecordingWriter(const std::string& path, const SetInfo& info, const WriterOptions& options)
    : impl_(std::make_unique<Impl>()) {
  impl_->path = path;
  impl_->options = options;
  impl_->info = info;
  impl_->info.captures.clear();
  if (fs::exists(path + "/recording.json")) {
    const RecordingSet there = RecordingSet::open(path);
    if (sensor_entry(there.info().sensor) != sensor_entry(info.sensor)) {
      throw Error(path + " is a recording of another sensor (" + there.info().sensor.name + "): choose another folder");
    }
    impl_->info = there.info();
  }
  make_folder(path);
  if (!info.valid_region.empty()) {
    const std::vector<unsigned char> bytes = png_bytes(info.valid_region, options.png_compression);
    write_file_atomically(path + "/valid_region.png", bytes.data(), bytes.size());
  }
}

RecordingWriter::~RecordingWriter() {
  try {
    finish_capture();
  } catch (const std::exception&) {  // the journal is on disk: nothing that was recorded is lost
  }
}

void RecordingWriter::begin_capture(const CaptureInfo& capture) {
  finish_capture();
  for (const CaptureInfo& there : impl_->info.captures) {
    if (there.key() == capture.key()) throw Error(impl_->path + " already has a capture " + capture.key());
  }
  impl_->folder = impl_->path + "/" + capture.folder();
  if (fs::exists(impl_->folder)) throw Error(impl_->folder + " exists already");
  make_folder(impl_->folder);
  impl_->open = capture;
  impl_->open->frames = 0;
  impl_->first_scale = 0;
  impl_->info.captures.push_back(*impl_->open);
  impl_->write_info();
}

void RecordingWriter::write(const Frame& frame) {
  Impl& self = *impl_;
  if (!self.open) throw Error("begin_capture comes before write");
  const int id = self.open->frames;
  frame.check(self.folder + ", frame " + std::to_string(id));
  double scale = frame.depth_scale_mm;
  if (scale <= 0) {
    double largest = 0;
    if (!frame.depth_mm.empty()) cv::minMaxLoc(frame.depth_mm, nullptr, &largest);
    scale = std::max(largest / 65535, 1e-6);
  }
  const auto files = self.encode(frame, id, scale);
  std::vector<std::string> written;
  try {
    for (const auto& [path, bytes] : files) {
      make_folder(fs::path(path).parent_path());
      write_file_atomically(path, bytes.data(), bytes.size());
      written.push_back(path);
    }
    json line = {{"id", id}, {"camera", camera_entry(frame, scale)}};
    if (frame.objects) line["gt"] = objects_entry(*frame.objects);
    const std::string text = line.dump() + "\n";
    const std::string journal = self.folder + "/" + journal_name;
    const int file = ::open(journal.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (file < 0) throw write_error(journal, errno);
    const off_t before = ::lseek(file, 0, SEEK_END);
    const ssize_t done = ::write(file, text.data(), text.size());
    const int code = done < 0 ? errno : ENOSPC;
    if (done != static_cast<ssize_t>(text.size()) && ::ftruncate(file, before) != 0) { /* the reader skips half lines */
    }
    ::close(file);
    if (done != static_cast<ssize_t>(text.size())) throw write_error(journal, code);
  } catch (...) {
    for (const std::string& path : written) ::unlink(path.c_str());
    throw;
  }
  if (id == 0) {
    self.first_camera = frame.camera;
    self.first_scale = scale;
  }
  ++self.open->frames;
}

void RecordingWriter::finish_capture() {
  Impl& self = *impl_;
  if (!self.open) return;
  const CaptureInfo capture = *self.open;
  self.open.reset();
  const std::string journal = self.folder + "/" + journal_name;
  const std::string cameras = self.folder + "/scene_camera.json", poses = self.folder + "/scene_gt.json";
  {
    std::ifstream lines(journal);
    std::ofstream camera_file(cameras + ".part"), pose_file(poses + ".part");
    bool any_pose = false, first_camera = true;
    camera_file << "{";
    pose_file << "{";
    for (std::string line; std::getline(lines, line);) {
      const json item = json::parse(line);
      const std::string key = "\n \"" + std::to_string(item["id"].get<int>()) + "\": ";
      camera_file << (first_camera ? "" : ",") << key << item["camera"].dump();
      first_camera = false;
      if (!item.contains("gt")) continue;
      pose_file << (any_pose ? "," : "") << key << item["gt"].dump();
      any_pose = true;
    }
    camera_file << "\n}\n";
    pose_file << "\n}\n";
    camera_file.close();
    pose_file.close();
    if (!camera_file || !pose_file) {
      fs::remove(cameras + ".part");
      fs::remove(poses + ".part");
      throw write_error(cameras, ENOSPC);  // the journal stays, so the capture stays readable
    }
    fs::rename(cameras + ".part", cameras);
    if (any_pose) fs::rename(poses + ".part", poses);
    else fs::remove(poses + ".part");
  }
  for (CaptureInfo& there : self.info.captures) {
    if (there.key() == capture.key()) there.frames = capture.frames;
  }
  self.write_info();
  if (capture.frames > 0 && !fs::exists(self.path + "/camera.json")) {
    const Camera& c = self.first_camera;
    const json camera = {{"fx", c.fx},       {"fy", c.fy},         {"cx", c.cx},
                         {"cy", c.cy},       {"width", c.width},   {"height", c.height},
                         {"depth_scale", self.first_scale}};
    write_file_atomically(self.path + "/camera.json", camera.dump(1));
  }
  fs::remove(journal);
}

void RecordingWriter::copy_models(const std::string& from_set) {
  const fs::path from = fs::path(from_set) / "models", to = fs::path(impl_->path) / "models";
  if (!fs::exists(from)) return;
  std::error_code code;
  fs::copy(from, to, fs::copy_options::recursive | fs::copy_options::skip_existing, code);
  if (code) throw write_error(to, code.value());
}

double RecordingWriter::storage_loss_mm() const { return impl_->loss_mm; }

}  // namespace binrig
