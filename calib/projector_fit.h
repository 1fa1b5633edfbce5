// Where the projector stands, from the shadows it throws.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/forward_model.h"

namespace binrig {

struct ProjectorFit {
  bool found = false;
  Vector3 xyz_mm = Vector3::Zero();     ///< camera frame
  std::array<double, 3> sigma_mm{};     ///< from the curvature of the misfit; infinite where the shadows do not say
  double iou = 0;                       ///< intersection over union of predicted and measured shadow on the captures used
  /// Asked for and found: x (mm, camera frame) of a second view that the points must be seen from as well, such as the
  /// infra-red camera of depth that was registered to a colour camera; and the IoU with the projector's shadow alone.
  std::optional<double> second_x_mm;
  double iou_alone = 0;
  std::vector<std::string> captures;    ///< keys of the captures used
  std::string message;                  ///< in words, for the report
};

/// Finds the projector whose shadow agrees best with the missing pixels of the train captures that have depth edges:
/// a grid along the baseline on both sides, then a simplex over x, y, z. Pixels without geometry, outside valid_region,
/// or seen at more than 65 degrees count nowhere. `found` is false, with the reason, where no capture has shadows (fewer
/// than 200 missing pixels beside edges) or no place explains them (in its shadow a pixel must be missing at least three
/// times as often as anywhere).
/// `second_view`: a pixel may also be missing because a second view on the x axis does not see it. Both places are
/// searched together (all pairs of the grid, then the simplex over x, y, z and the second x). Shadows cannot tell a
/// projector from a camera: the one farther away is called the projector. The second view is kept where, outside the
/// projector's shadow, its own holds missing pixels at least three times as often as all that lies outside.
ProjectorFit fit_projector(const ForwardModel& forward, const RecordingSet& set, const SensorModel& model,
                           bool second_view = false);

}  // namespace binrig
