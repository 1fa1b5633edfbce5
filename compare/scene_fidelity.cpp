#include "compare/scene_fidelity.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "core/error.h"

namespace binrig {

namespace {

constexpr float edge_margin_px = 4;

ResidualFrame departure(const Frame& frame, const Channels& perfect, const cv::Mat& region) {
  ResidualFrame out;
  out.residual_mm = cv::Mat(frame.depth_mm.size(), CV_32F, cv::Scalar(0));
  out.valid = cv::Mat(frame.depth_mm.size(), CV_8U, cv::Scalar(0));
  for (int r = 0; r < out.valid.rows; ++r) {
    for (int c = 0; c < out.valid.cols; ++c) {
      const float z = frame.depth_mm.at<float>(r, c), p = perfect.depth_mm.at<float>(r, c);
      if (z <= 0 || p <= 0 || perfect.edge_px.at<float>(r, c) <= edge_margin_px) continue;
      if (!region.empty() && !region.at<std::uint8_t>(r, c)) continue;
      out.residual_mm.at<float>(r, c) = z - p;
      out.valid.at<std::uint8_t>(r, c) = 1;
      ++out.pixels;
    }
  }
  return out;
}

double median_of(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// One stream's departures: pixel maps, and values of every few pixels of up to 20 frames for the medians.
struct Departures {
  std::unique_ptr<PixelMaps> maps;
  std::vector<float> values;
  cv::Mat first, first_valid;

  void add(const Frame& frame, const Channels& perfect, const cv::Mat& region) {
    const ResidualFrame residual = departure(frame, perfect, region);
    if (!maps) {
      maps = std::make_unique<PixelMaps>(residual.valid.size(), cv::Mat(residual.valid.size(), CV_8U, cv::Scalar(1)));
      first = residual.residual_mm;
      first_valid = residual.valid;
    }
    maps->add(residual);
    if (maps->frames() > 20) return;
    for (int r = 0; r < residual.valid.rows; r += 2) {
      for (int c = 0; c < residual.valid.cols; c += 2) {
        if (residual.valid.at<std::uint8_t>(r, c)) values.push_back(residual.residual_mm.at<float>(r, c));
      }
    }
  }

  DepthDeparture finish() {
    DepthDeparture out;
    out.pixels = static_cast<double>(values.size()) * 4;
    out.median_mm = median_of(values);
    for (float& v : values) v = std::abs(v - static_cast<float>(out.median_mm));
    out.spread_mm = 1.4826 * median_of(values);
    if (maps && maps->frames() > 1) {
      const cv::Mat sigma = maps->temporal_sigma_mm();
      std::vector<float> sigmas;
      for (int r = 0; r < sigma.rows; ++r) {
        for (int c = 0; c < sigma.cols; ++c) {
          if (maps->count().at<float>(r, c) >= 2) sigmas.push_back(sigma.at<float>(r, c));
        }
      }
      out.temporal_sigma_mm = median_of(sigmas);
    }
    return out;
  }
};

}  // namespace

struct SceneComparison::Impl {
  SceneFidelity scene;
  cv::Mat valid_region;
  Departures measured, simulated;
  double missing = 0, missing_outside = 0;

  cv::Mat counted(const Channels& perfect) const {
    cv::Mat out = perfect.depth_mm > 0;
    return valid_region.empty() ? out : cv::Mat(out & valid_region);
  }
};

SceneComparison::SceneComparison(const std::string& capture, const std::vector<std::string>& models,
                                 const cv::Mat& valid_region)
    : impl_(std::make_unique<Impl>()) {
  if (models.empty()) throw Error("a scene is compared with at least one model");
  impl_->scene.capture = capture;
  impl_->scene.models = models;
  impl_->scene.tallies.resize(models.size());
  impl_->valid_region = valid_region;
}

SceneComparison::~SceneComparison() = default;

void SceneComparison::add_measured(const Frame& frame, const Channels& perfect) {
  if (frame.depth_mm.empty()) return;
  SceneFidelity& scene = impl_->scene;
  if (scene.frames++ == 0) {
    scene.measured_depth_mm = frame.depth_mm.clone();
    scene.measured_reason = frame.reason.clone();
  }
  impl_->measured.add(frame, perfect, impl_->valid_region);
  for (int r = 0; r < frame.reason.rows; ++r) {
    for (int c = 0; c < frame.reason.cols; ++c) {
      if (frame.reason.at<std::uint8_t>(r, c) == 0) continue;
      if (!impl_->valid_region.empty() && !impl_->valid_region.at<std::uint8_t>(r, c)) continue;
      impl_->missing += 1;
      impl_->missing_outside += perfect.depth_mm.at<float>(r, c) <= 0;
    }
  }
}

void SceneComparison::add_simulated(int model, const Frame& simulated, const Frame& measured, const Channels& perfect) {
  if (measured.depth_mm.empty() || simulated.depth_mm.empty()) return;
  SceneFidelity& scene = impl_->scene;
  const cv::Mat counted = impl_->counted(perfect);
  scene.tallies.at(model).add(measured.reason, simulated.reason, counted);
  if (model + 1 != static_cast<int>(scene.models.size())) return;
  if (scene.predicted_reason.empty()) {
    scene.simulated_depth_mm = simulated.depth_mm.clone();
    scene.predicted_reason = simulated.reason.clone();
    scene.outcome = outcome_map(measured.reason, simulated.reason, counted);
  }
  impl_->simulated.add(simulated, perfect, impl_->valid_region);
}

SceneFidelity SceneComparison::finish(std::uint64_t seed) {
  SceneFidelity& scene = impl_->scene;
  if (scene.frames == 0) throw Error("capture " + scene.capture + " has no frame");
  for (std::size_t i = 0; i < scene.models.size(); ++i) {
    scene.scores.push_back(mask_score(scene.models[i], {&scene.tallies[i]}, seed));
  }
  scene.outside_share = impl_->missing > 0 ? impl_->missing_outside / impl_->missing : 0;
  scene.measured = impl_->measured.finish();
  scene.simulated = impl_->simulated.finish();
  scene.measured_departure_mm = impl_->measured.first;
  scene.measured_departure_valid = impl_->measured.first_valid;
  scene.simulated_departure_mm = impl_->simulated.first;
  scene.simulated_departure_valid = impl_->simulated.first_valid;
  if (scene.frames > 1 && impl_->simulated.maps) {
    scene.measured_bias_mm = impl_->measured.maps->mean_mm();
    scene.simulated_bias_mm = impl_->simulated.maps->mean_mm();
    scene.measured_sigma_mm = impl_->measured.maps->temporal_sigma_mm();
    scene.simulated_sigma_mm = impl_->simulated.maps->temporal_sigma_mm();
  }
  return scene;
}

std::vector<Aspect> scene_aspects(const SceneFidelity& scene, const std::optional<double>& offset_tolerance_mm) {
  constexpr double no_test = std::numeric_limits<double>::quiet_NaN();
  std::vector<Aspect> out;
  const auto add = [&](const std::string& id, const std::string& title, const std::string& unit, double measured,
                       double simulated, double effect, const std::string& effect_unit, double tolerance) -> Aspect& {
    Aspect a{id, title, unit, measured, simulated, effect, effect_unit, tolerance};
    a.raw_p = no_test;
    a.capture = scene.capture;
    out.push_back(a);
    return out.back();
  };
  const auto relative = [](double m, double s) { return m > 0 ? s / m - 1 : 0; };
  const MaskScore& score = scene.scores.back();
  Aspect& missing = add("missing_share", "missing share of the surface", "1", score.missing_share,
                        score.predicted_share, relative(score.missing_share, score.predicted_share), "relative", 0.25);
  // Block by block, as missing pixels come in patches.
  std::vector<double> differences;
  double pixels = 0, total = 0, square = 0;
  for (const auto& block : scene.tallies.back().blocks()) {
    if (block.pixels <= 0) continue;
    double predicted = 0;
    for (const double p : block.predicted) predicted += p;
    differences.push_back(predicted - block.missing);
    total += differences.back();
    pixels += block.pixels;
  }
  for (const double d : differences) square += std::pow(d - total / differences.size(), 2);
  const double n = static_cast<double>(differences.size());
  if (n >= 8 && square > 0) {
    missing.degrees_of_freedom = n - 1;
    missing.raw_p = student_two_sided(total / std::sqrt(square * n / (n - 1)), n - 1);
  }
  if (score.missing_share > 0) {
    add("mask_unexplained", "missing pixels that no reason explains", "1", no_test, score.unexplained.value,
        score.unexplained.value, "1", 0.25);
  }
  if (score.predicted_share > 0) {
    add("mask_false", "pixels predicted missing that are measured", "1", no_test, 1 - score.precision.value,
        1 - score.precision.value, "1", 0.25);
  }
  add("depth_spread", "spread of depth about the nominal scene", "mm", scene.measured.spread_mm,
      scene.simulated.spread_mm, relative(scene.measured.spread_mm, scene.simulated.spread_mm), "relative", 0.25);
  if (scene.frames > 1) {
    add("scene_noise", "noise over time (median of pixels)", "mm", scene.measured.temporal_sigma_mm,
        scene.simulated.temporal_sigma_mm,
        relative(scene.measured.temporal_sigma_mm, scene.simulated.temporal_sigma_mm), "relative", 0.1);
  }
  if (offset_tolerance_mm) {
    add("depth_offset", "median depth against the nominal scene", "mm", scene.measured.median_mm,
        scene.simulated.median_mm, scene.simulated.median_mm - scene.measured.median_mm, "mm", *offset_tolerance_mm);
  }
  return out;
}

namespace {

nlohmann::json interval_json(const ShareInterval& s) { return {{"value", s.value}, {"ci95", {s.low, s.high}}}; }

}  // namespace

nlohmann::json score_json(const MaskScore& score) {
  nlohmann::json out{{"model", score.model},
                     {"pixels", score.pixels},
                     {"missing_share", score.missing_share},
                     {"predicted_share", score.predicted_share},
                     {"precision", interval_json(score.precision)},
                     {"recall", interval_json(score.recall)},
                     {"iou", interval_json(score.iou)},
                     {"unexplained", interval_json(score.unexplained)},
                     {"by_reason", nlohmann::json::object()}};
  for (const auto& r : score.by_reason) {
    out["by_reason"][reason_name(r.reason)] = {{"predicted_share", r.predicted_share},
                                               {"precision", interval_json(r.precision)},
                                               {"recall", interval_json(r.recall)},
                                               {"iou", interval_json(r.iou)}};
  }
  return out;
}

nlohmann::json scene_json(const SceneFidelity& scene) {
  const auto depth = [](const DepthDeparture& d) {
    return nlohmann::json{{"pixels", d.pixels},
                          {"median_mm", d.median_mm},
                          {"spread_mm", d.spread_mm},
                          {"temporal_sigma_mm", d.temporal_sigma_mm}};
  };
  nlohmann::json out{{"capture", scene.capture},
                     {"held_out", scene.held_out},
                     {"frames", scene.frames},
                     {"missing_where_the_model_has_no_surface", scene.outside_share},
                     {"depth_measured", depth(scene.measured)},
                     {"depth_simulated", depth(scene.simulated)}};
  for (const auto& score : scene.scores) out["masks"].push_back(score_json(score));
  return out;
}

}  // namespace binrig
