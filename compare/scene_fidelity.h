// Measured against simulated frames of a scene: which pixels are missing and why, and how far depth is off where both
// have it.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "compare/fidelity.h"
#include "compare/masks.h"
#include "compare/noise/pixel_maps.h"
#include "core/channels.h"

namespace binrig {

/// Depth minus perfect depth on surfaces away from depth edges (> 4 px), over all frames.
struct DepthDeparture {
  double pixels = 0;
  double median_mm = 0;
  double spread_mm = 0;          ///< 1.4826 times the median absolute deviation: pose and mesh errors are in it
  double temporal_sigma_mm = 0;  ///< median over pixels of the standard deviation over frames; 0 with one frame
};

struct SceneFidelity {
  std::string capture, name;
  bool held_out = false;
  int frames = 0;
  std::vector<std::string> models;  ///< of the tallies, in order; the last is the whole model
  std::vector<MaskTally> tallies;
  std::vector<MaskScore> scores;  ///< one a model
  double outside_share = 0;       ///< of the measured missing pixels: where the model has no surface (counted nowhere)
  DepthDeparture measured, simulated;

  /// Of the first frame. Reasons of the whole model.
  cv::Mat measured_reason, predicted_reason, outcome;  ///< CV_8U
  cv::Mat measured_depth_mm, simulated_depth_mm;       ///< CV_32F
  cv::Mat measured_departure_mm, simulated_departure_mm, measured_departure_valid, simulated_departure_valid;
  /// Over all frames.
  cv::Mat measured_bias_mm, simulated_bias_mm, measured_sigma_mm, simulated_sigma_mm;
};

/// Frames of one capture, measured and simulated, pass through here one after the other.
class SceneComparison {
 public:
  /// `models`: names of the models that will be added, the whole model last. `valid_region`: CV_8U or empty.
  SceneComparison(const std::string& capture, const std::vector<std::string>& models, const cv::Mat& valid_region);
  ~SceneComparison();
  /// Channels: depth and edge_distance of the nominal scene at that frame.
  void add_measured(const Frame& frame, const Channels& perfect);
  /// A simulated frame of model `model` and its measured counterpart.
  void add_simulated(int model, const Frame& simulated, const Frame& measured, const Channels& perfect);
  SceneFidelity finish(std::uint64_t seed);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// What is asked of a scene: how much is missing, how much of it is explained, whether what is predicted missing is,
/// how far depth scatters. `offset_tolerance_mm`: how far the median depth may be off; absent where the poses were
/// fitted to this very depth or are not known well enough to ask.
std::vector<Aspect> scene_aspects(const SceneFidelity& scene, const std::optional<double>& offset_tolerance_mm);

nlohmann::json scene_json(const SceneFidelity& scene);
nlohmann::json score_json(const MaskScore& score);

}  // namespace binrig
