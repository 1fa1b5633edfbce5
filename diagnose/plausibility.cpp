#include "diagnose/plausibility.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/error.h"

namespace binrig {
namespace {

/// Share of the targets' pixels that have depth, and medians over the bins of |measured - nominal| and of the ratio.
struct Plausibility {
  double known_share = 0, median_error_mm = 0, median_ratio = 1;
};

Plausibility plausibility(const Experiment& experiment, const StatVector& data) {
  Plausibility result;
  std::vector<double> errors, ratios;
  for (int c = 0; c < experiment.layout().captures; ++c) {
    const Block* block = experiment.layout().find(c, "bias");
    if (!block) continue;
    const double distance =
        cv::sum(experiment.nominal(c).depth_mm)[0] / std::max(1, cv::countNonZero(experiment.nominal(c).depth_mm));
    for (int i = block->offset; i < block->offset + block->size; ++i) {
      if (std::isnan(data[i])) continue;
      errors.push_back(std::abs(data[i]));
      ratios.push_back((distance + data[i]) / distance);
    }
  }
  if (errors.empty()) return result;
  double cells = 0;
  for (const auto& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != "drop-out") continue;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (!std::isnan(data[i])) result.known_share += std::pow(std::cos(data[i]), 2), cells += 1;
  }
  if (cells > 0) result.known_share /= cells;
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
  result.median_error_mm = errors[errors.size() / 2];
  result.median_ratio = ratios[ratios.size() / 2];
  return result;
}

}  // namespace

void check_registration(const Experiment& experiment, const StatVector& data, const SensorModel& model) {
  const Plausibility seen = plausibility(experiment, data);
  double distance = 0;
  for (int c = 0; c < experiment.layout().captures; ++c)
    distance += cv::sum(experiment.nominal(c).depth_mm)[0] /
                std::max(1, cv::countNonZero(experiment.nominal(c).depth_mm)) / experiment.layout().captures;
  if (seen.median_error_mm > 0.03 * distance) {
    const std::string unit = seen.median_ratio < 0.01 || seen.median_ratio > 50
                                 ? " Are the depths or the poses in another unit (metres for millimetres)?"
                                 : " Are the poses or the camera those of this recording?";
    throw Error(
        fmt::format("Model and recording do not describe the same scene: half of the measured depths are more "
                    "than {:.3g} mm from where the targets are said to stand ({:.3g} mm away).{} No effect is "
                    "looked for before this is mended.",
                    seen.median_error_mm, distance, unit));
  }
  // Holes on the other side of every object: the projector stands there. Compared on drop-outs alone.
  const auto projector = model.projector_known ? std::optional<Vector3>(model.projector_xyz_mm)
                                               : experiment.forward().set().sensor.projector();
  if (!projector || std::abs(projector->x()) < 1) return;
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  if (std::none_of(model.effects.begin(), model.effects.end(), [&](const EffectInstance& e) {
        const auto& d = e.declaration(catalogue);
        return d.needs.baseline && d.reason.has_value();
      }))
    return;
  SensorModel as_given = model, mirrored = model;
  for (SensorModel* m : {&as_given, &mirrored}) {
    m->projector_from = Given::written;
    m->projector_known = true;
    m->projector_xyz_mm = *projector;
  }
  mirrored.projector_xyz_mm = -*projector;
  const auto simulated =
      experiment.simulate({Trial{as_given, {}, 11, Part::all, 1, true}, Trial{mirrored, {}, 11, Part::all, 1, true}},
                          "looking which side the shadows are on");
  double apart[2] = {0, 0}, differ = 0;
  for (const auto& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != "drop-out") continue;
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      if (std::isnan(data[i]) || std::isnan(simulated[0][i]) || std::isnan(simulated[1][i])) continue;
      for (int k = 0; k < 2; ++k) apart[k] += std::pow(data[i] - simulated[k][i], 2);
      differ += std::pow(simulated[0][i] - simulated[1][i], 2);
    }
  }
  // Right side: apart[1] - apart[0] is about +differ; wrong side: about -differ.
  if (differ > 5 && apart[0] - apart[1] > 0.5 * differ)
    throw Error(
        "The measured shadows lie on the other side of the objects than this model predicts: is the sign of the "
        "baseline (the projector's x) wrong? No effect is looked for before this is mended.");
}

std::vector<std::string> lacking_data(const Experiment& experiment, const StatVector& data) {
  std::vector<std::string> lacking;
  const Layout& layout = experiment.layout();
  const int train = static_cast<int>(std::count(layout.train.begin(), layout.train.end(), true));
  if (train == 0) lacking.push_back("captures in the split \"train\" to fit on");
  if (train == layout.captures)
    lacking.push_back(
        "captures in the split \"test\" to hold out: an effect is only named if it also explains captures that it was "
        "not fitted to");
  if (plausibility(experiment, data).known_share < 0.15)
    lacking.push_back("captures with depth: fewer than 15 % of the places where the targets are have any");
  if (!experiment.repeats())
    lacking.push_back("several frames of a target (at least 3): noise cannot be told from shape in single frames");
  return lacking;
}

}  // namespace binrig
