// What a BOP dataset has beyond a recording: models with their symmetries, whole masks, visibility, targets.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "sim/renderer.h"
#include "sim/world.h"

namespace binrig {

/// models/obj_000001.ply ... (binary, mm) and models/models_info.json for every part of the world, obj_id counting
/// from 1. Throws Error if a file cannot be written.
void write_bop_models(const World& world, const std::string& set_folder);

/// One object of one frame, as scene_gt_info.json has it. `all`: the silhouette with what lies beyond the border of the
/// image (of a camera with lens distortion: without); `valid` and `visible`: inside the image.
struct Visibility2d {
  cv::Rect box_all, box_visible;
  int pixels_all = 0, pixels_valid = 0, pixels_visible = 0;
  double visible_share() const { return pixels_all > 0 ? static_cast<double>(pixels_visible) / pixels_all : 0; }
};

/// Renders each of the first `parts` objects of the scene alone: its whole mask (CV_8U, 255 inside) and how much of it
/// `ids` (k = visible part of object k-1) shows. pixels_valid counts the whole mask's pixels with a valid depth.
struct ObjectMasks {
  std::vector<cv::Mat> whole;
  std::vector<Visibility2d> info;
};
ObjectMasks object_masks(const Renderer& renderer, const RenderScene& scene, const RenderRequest& request,
                         std::size_t parts, const cv::Mat& ids, const cv::Mat& depth_mm);

/// Collects masks and scene_gt_info.json of one capture and targets of the set.
class BopExtras {
 public:
  explicit BopExtras(std::string set_folder) : set_(std::move(set_folder)) {}
  void begin_capture(const std::string& folder, int scene_id);
  /// mask/000000_000000.png ... now; the rest when the capture ends.
  void add(int frame_id, const ObjectMasks& masks, const std::vector<int>& obj_ids);
  void finish_capture();
  /// test_targets_bop19.json: objects of which at least a tenth is visible.
  void write_targets() const;

 private:
  struct Target {
    int scene_id, frame_id, obj_id, count;
  };
  std::string set_, folder_, info_text_;
  int scene_id_ = 0;
  std::vector<Target> targets_;
};

}  // namespace binrig
