// Names and small parts of the recording format that reader and writer share. Not for others.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "core/recording_set.h"

namespace binrig::recording_files {

inline constexpr const char* journal_name = "journal.jsonl";

/// "000012"
std::string six_digits(int number);
/// SET/train/000001/KIND/000003.png
std::string image_path(const std::string& capture_folder, const std::string& kind, int frame_id);
/// mask_visib/000003_000001.png
std::string mask_path(const std::string& capture_folder, const std::string& kind, int frame_id, int index);

/// The entry of scene_camera.json for a frame, with every extra key that the frame needs, and back. Reading throws
/// Error naming `where` and every violation; `fallback` is camera.json's camera and depth_scale, `size` the image size.
nlohmann::json camera_entry(const Frame& frame, double depth_scale_mm);
void read_camera_entry(const nlohmann::json& entry, const Camera& fallback, double fallback_scale_mm,
                       const std::optional<double>& frame_rate_hz, const std::string& where, Frame& frame);

nlohmann::json objects_entry(const std::vector<ObjectPose>& objects);
std::vector<ObjectPose> read_objects_entry(const nlohmann::json& entry, const std::string& where);

nlohmann::json sensor_entry(const SensorInfo& sensor);

}  // namespace binrig::recording_files
