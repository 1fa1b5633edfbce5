#include "compare/scene_report.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

namespace binrig {

namespace {

std::string with_interval(const ShareInterval& s) {
  return fmt::format("{:.1f}\u00a0% ({:.0f}\u2013{:.0f})", 100 * s.value, 100 * s.low, 100 * s.high);
}

Table score_table(const std::vector<MaskScore>& scores, const std::string& caption) {
  Table table;
  table.caption = caption;
  table.columns = {
      "model", "missing", "predicted missing", "precision", "recall", "intersection over union", "no reason explains"};
  for (const MaskScore& s : scores) {
    table.rows.push_back({s.model, percent(s.missing_share), percent(s.predicted_share), with_interval(s.precision),
                          with_interval(s.recall), with_interval(s.iou), with_interval(s.unexplained)});
  }
  return table;
}

Table reason_table(const MaskScore& score) {
  Table table;
  table.caption = fmt::format(
      "Missing pixels by the reason that \u201c{}\u201d predicts, with 95 % intervals from a block bootstrap.",
      score.model);
  table.columns = {"predicted reason", "share of pixels", "of these missing (precision)", "of all missing (recall)",
                   "intersection over union"};
  for (const ReasonScore& r : score.by_reason) {
    table.rows.push_back({reason_categories()[static_cast<std::size_t>(r.reason)].label, percent(r.predicted_share),
                          with_interval(r.precision), with_interval(r.recall), with_interval(r.iou)});
  }
  table.rows.push_back({"none", "-", "-", with_interval(score.unexplained), "-"});
  return table;
}

const std::vector<Category>& outcomes() {
  static const std::vector<Category> list{{"not counted", {222, 222, 226}},
                                          {"measured, as predicted", {246, 246, 244}},
                                          {"missing, as predicted", {40, 62, 120}},
                                          {"missing, not predicted", {204, 82, 40}},
                                          {"predicted missing, but measured", {240, 190, 40}}};
  return list;
}

MapFigure pair(const std::string& name, const std::string& caption, ColourScale colours, const cv::Mat& a,
               const cv::Mat& a_valid, const cv::Mat& b, const cv::Mat& b_valid) {
  MapFigure figure;
  figure.name = name;
  figure.alt = caption.substr(0, caption.find('.'));
  figure.caption = caption;
  figure.unit = "mm";
  figure.colours = colours;
  figure.panels = {{"measured", a, a_valid}, {"simulated", b, b_valid}};
  return figure;
}

CloudFigure scene_clouds(const std::string& name, const SceneFidelity& scene) {
  CloudFigure figure;
  figure.name = name;
  figure.unit = "mm";
  figure.colours = ColourScale::sequential;
  figure.yaw_rad = 0.35;
  figure.pitch_rad = -0.5;
  const auto panel = [&](const cv::Mat& depth, const char* title) {
    CloudPanel out{title, {}, {}};
    const int step = std::max(1, static_cast<int>(std::sqrt(depth.total() / 38000.0)));
    for (int r = 0; r < depth.rows; r += step) {
      for (int c = 0; c < depth.cols; c += step) {
        const float z = depth.at<float>(r, c);
        if (z <= 0) continue;
        // Rays of a camera with the image's width as focal length: near enough to look at.
        out.points.emplace_back(z * (c - 0.5f * depth.cols) / depth.cols, z * (r - 0.5f * depth.rows) / depth.cols, z);
        out.values.push_back(z);
      }
    }
    return out;
  };
  figure.panels = {panel(scene.measured_depth_mm, "measured"), panel(scene.simulated_depth_mm, "simulated")};
  std::vector<float> all = figure.panels[0].values;
  if (all.empty()) all = {0.f, 1.f};
  std::sort(all.begin(), all.end());
  figure.low = all[static_cast<std::size_t>(0.02 * (all.size() - 1))];
  figure.high = std::max<double>(figure.low + 1e-3, all[static_cast<std::size_t>(0.98 * (all.size() - 1))]);
  // Points far behind everything else would make the rest a speck.
  const auto cut = static_cast<float>(figure.high + 0.5 * (figure.high - figure.low));
  for (auto& p : figure.panels) {
    CloudPanel kept{p.title, {}, {}};
    for (std::size_t i = 0; i < p.points.size(); ++i) {
      if (p.values[i] > cut) continue;
      kept.points.push_back(p.points[i]);
      kept.values.push_back(p.values[i]);
    }
    p = kept;
  }
  figure.alt = "point clouds of the scene";
  figure.caption = "The first frame as a point cloud, coloured by depth.";
  return figure;
}

void draw_scene(Page& page, const SceneFidelity& scene) {
  std::string p = scene.capture + "_";
  std::replace(p.begin(), p.end(), '/', '_');
  page.section(fmt::format("{} {}, {}", scene.capture, scene.name,
                           scene.frames == 1 ? std::string("one frame") : fmt::format("{} frames", scene.frames)));
  page.text(mask_sentence(scene.scores.back()));
  CategoryFigure reasons{p + "reasons", "missing pixels by reason", "", {}, reason_categories(), {}};
  reasons.panels = {{"measured", scene.measured_reason}, {"simulated", scene.predicted_reason}};
  reasons.caption =
      "Missing pixels of the first frame. A real camera rarely says why a pixel is missing; the simulation gives the "
      "reason.";
  page.figure(reasons);
  CategoryFigure outcome{p + "outcome", "what was predicted and came true", "", {}, outcomes(), {}};
  outcome.panels = {{"measured against predicted", scene.outcome}};
  outcome.caption =
      "What came true. Pixels without a surface in the model, or outside the recording's valid region, are not "
      "counted.";
  page.figure(outcome);
  auto depth = pair(p + "depth", "Depth of the first frame, both at the same colour scale.", ColourScale::sequential,
                    scene.measured_depth_mm, cv::Mat(scene.measured_depth_mm > 0), scene.simulated_depth_mm,
                    cv::Mat(scene.simulated_depth_mm > 0));
  page.figure(depth);
  page.figure(pair(p + "departure", "Depth minus perfect depth of the nominal scene, away from depth edges.",
                   ColourScale::diverging, scene.measured_departure_mm, scene.measured_departure_valid,
                   scene.simulated_departure_mm, scene.simulated_departure_valid));
  page.figure(scene_clouds(p + "cloud", scene));
  if (!scene.measured_bias_mm.empty()) {
    page.figure(pair(p + "bias", "Bias map: the mean over the frames of depth minus perfect depth.",
                     ColourScale::diverging, scene.measured_bias_mm, cv::Mat(scene.measured_bias_mm != 0),
                     scene.simulated_bias_mm, cv::Mat(scene.simulated_bias_mm != 0)));
    page.figure(pair(p + "sigma", "Standard deviation over time, pixel by pixel.", ColourScale::sequential,
                     scene.measured_sigma_mm, cv::Mat(scene.measured_sigma_mm > 0), scene.simulated_sigma_mm,
                     cv::Mat(scene.simulated_sigma_mm > 0)));
  }
  page.table(score_table(scene.scores, "Missing pixels of this capture."));
  if (!scene.scores.back().by_reason.empty()) page.table(reason_table(scene.scores.back()));
}

}  // namespace

std::vector<ScenePool> pool_scenes(const std::vector<SceneFidelity>& scenes, std::uint64_t seed) {
  std::map<std::string, std::vector<const SceneFidelity*>> by_split;
  for (const auto& s : scenes) by_split[s.held_out ? "test" : "train"].push_back(&s);
  std::vector<ScenePool> pools;
  for (const auto& [split, members] : by_split) {
    ScenePool pool{split, {}};
    for (std::size_t m = 0; m < members.front()->models.size(); ++m) {
      std::vector<const MaskTally*> tallies;
      for (const auto* s : members) tallies.push_back(&s->tallies[m]);
      pool.scores.push_back(mask_score(members.front()->models[m], tallies, seed));
    }
    pools.push_back(pool);
  }
  return pools;
}

std::string mask_sentence(const MaskScore& s) {
  if (s.missing_share == 0)
    return "No pixel of the surface is missing in the measurement; " + percent(s.predicted_share) +
           " are in the simulation.";
  return fmt::format(
      "Missing in the measurement: {} of the surface; in the simulation: {}. Of the missing pixels {:.0f} % are "
      "explained by a "
      "reason, {:.0f} % ({:.0f} to {:.0f}) are not; of the pixels that are predicted missing, {:.0f} % are.",
      percent(s.missing_share), percent(s.predicted_share), 100 * s.recall.value, 100 * s.unexplained.value,
      100 * s.unexplained.low, 100 * s.unexplained.high, 100 * s.precision.value);
}

void draw_scenes(Page& page, const std::vector<SceneFidelity>& scenes, const std::vector<ScenePool>& pools,
                 int detailed) {
  if (scenes.empty()) return;
  page.section("Missing pixels by reason");
  for (const auto& pool : pools) {
    page.table(score_table(
        pool.scores,
        fmt::format("Missing pixels of all {} captures together. Intervals: 95 %, by drawing whole blocks of {} px "
                    "again and again.",
                    pool.split, MaskTally::block_px)));
    if (!pool.scores.back().by_reason.empty()) page.table(reason_table(pool.scores.back()));
  }
  Table table;
  table.caption =
      "Depth minus perfect depth of the nominal scene, away from depth edges. The spread holds errors of poses and "
      "meshes, too.";
  table.columns = {"capture",
                   "frames",
                   "median measured, mm",
                   "median simulated, mm",
                   "spread measured, mm",
                   "spread simulated, mm",
                   "noise over time measured, mm",
                   "simulated, mm",
                   "missing outside the model"};
  for (const auto& s : scenes) {
    table.rows.push_back(
        {s.capture, s.frames, s.measured.median_mm, s.simulated.median_mm, s.measured.spread_mm, s.simulated.spread_mm,
         s.frames > 1 ? TableCell(s.measured.temporal_sigma_mm) : TableCell("-"),
         s.frames > 1 ? TableCell(s.simulated.temporal_sigma_mm) : TableCell("-"), percent(s.outside_share)});
  }
  page.table(table);
  int drawn = 0;
  for (const bool held_out : {true, false}) {
    for (const auto& s : scenes) {
      if (s.held_out == held_out && drawn < detailed) {
        draw_scene(page, s);
        ++drawn;
      }
    }
  }
}

}  // namespace binrig
