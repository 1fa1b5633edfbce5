// Where the projector stands, from the shadows it throws.
#pragma once

#include <string>
#include <vector>

#include "core/forward_model.h"

namespace binrig {

struct ProjectorFit {
  bool found = false;
  Vector3 xyz_mm = Vector3::Zero();     ///< camera frame
  std::array<double, 3> sigma_mm{};     ///< from the curvature of the misfit; infinite where the shadows do not say
  double iou = 0;                       ///< intersection over union of predicted and measured shadow on the captures used
  std::vector<std::string> captures;    ///< keys of the captures used
  std::string message;                  ///< in words, for the report
};

/// Finds the projector whose shadow agrees best with the missing pixels of the train captures that have depth edges:
/// a grid along the baseline on both sides, then a simplex over x, y, z. Pixels without geometry, outside valid_region,
/// or seen at more than 65 degrees count nowhere. `found` is false, with the reason, where no capture has shadows (fewer
/// than 200 missing pixels beside edges) or no place explains them (in its shadow a pixel must be missing at least three
/// times as often as anywhere).
ProjectorFit fit_projector(const ForwardModel& forward, const RecordingSet& set, const SensorModel& model);

}  // namespace binrig
