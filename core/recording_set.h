// Reading a recording set (BOP layout with a few extra keys; docs/recordings.md).
//
// Reading is lenient: unknown keys are ignored and optional files may be missing. A broken file is one Error that names
// the file and the frame, and the other frames stay usable. Nothing larger than one frame is held in memory.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/frame.h"
#include "core/frame_source.h"

namespace binrig {

enum class TargetKind { plane, scene };

struct CaptureInfo {
  std::string split;  ///< "train" or "test"
  int id = 0;
  std::string name;
  TargetKind target = TargetKind::scene;
  int frames = 0;
  bool power_on = false;

  /// "train/1": the key of messages, of random streams and of the command line.
  std::string key() const { return split + "/" + std::to_string(id); }
  /// "train/000001": the folder in the set.
  std::string folder() const;
};

/// What recording.json says of the whole set.
struct SetInfo {
  std::string path;
  SensorInfo sensor;
  std::optional<double> pose_sigma_mm, pose_sigma_rad;  ///< 1 sigma, rigid, per capture; absent = unknown
  std::optional<std::array<double, 3>> cam_K_sigma_px;  ///< 1 sigma of fx = fy, cx, cy
  bool poses_fitted_to_this_depth = false;
  bool region_masks = false;  ///< mask_visib marks the flat part of plane targets
  cv::Mat valid_region;       ///< CV_8U or empty
  std::vector<CaptureInfo> captures;
};

/// Mesh and surface of a model of the set, as models/models_info.json has it.
struct ModelInfo {
  int obj_id = 0;
  std::string mesh_path;  ///< PLY, mm
  double diameter_mm = 0;
  std::optional<double> albedo, specular, shininess;
};

/// The flat part of a plane target as mask_visib of this frame marks it: CV_8U of the frame's size, not 0, 2 px inside the
/// mark's rim, since what stands beside it reaches in. Empty where nothing is marked, or masks are of something else
/// (`region_masks` of SetInfo is not set).
cv::Mat marked_region(const Frame& frame, bool region_masks);

/// One capture, frame by frame. Cheap to copy.
class CaptureReader {
 public:
  const CaptureInfo& info() const;
  /// Number of frames whose image is there or was announced; frame(i) of a missing one throws.
  int size() const;
  /// Frame i = 0 .. size()-1 in the order of their ids. Depth 0 gets its reason from reason/, else `unknown`.
  /// Throws Error naming file and frame: truncated or missing PNG, not 16-bit, wrong size, no K, depth_scale <= 0, NaN.
  Frame frame(int i) const;
  /// What scene_camera.json and scene_gt.json say of frame i (camera, poses, times), without any image.
  Frame header(int i) const;
  /// The id of frame i in file names.
  int frame_id(int i) const;
  /// All objects that mask_visib or scene_gt know of in frame i.
  bool has_depth() const;

 private:
  friend class RecordingSet;
  struct Data;
  std::shared_ptr<const Data> data_;
};

class RecordingSet {
 public:
  /// Throws Error: not a directory, no recording.json or not JSON, no captures, a capture without its folder.
  /// recording.json may be missing in a plain BOP dataset: splits and scenes are then found by their folders.
  static RecordingSet open(const std::string& path);

  const SetInfo& info() const { return *info_; }
  const std::vector<CaptureInfo>& captures() const { return info_->captures; }
  /// Throws Error if there is no such capture, listing those there are.
  CaptureReader capture(const std::string& split, int id) const;
  CaptureReader capture(const std::string& key) const;  ///< "train/1"
  /// Where a capture speaks of its target, CV_8U of the frames' size, not 0: inside the set's valid region and, where a
  /// plane target is marked, inside the marks of all its frames that can be read and have one. Empty = everywhere. Reads
  /// all frames of a marked target; broken ones are left to whoever needs their image.
  cv::Mat region(const CaptureInfo& capture) const;
  /// Empty where the set has no models. Throws Error if models_info.json is broken.
  const std::vector<ModelInfo>& models() const { return models_; }

 private:
  std::shared_ptr<const SetInfo> info_;
  std::vector<ModelInfo> models_;
};

}  // namespace binrig
