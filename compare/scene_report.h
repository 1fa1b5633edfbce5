// Draws the comparison of scenes into a report.
#pragma once

#include <string>
#include <vector>

#include "compare/scene_fidelity.h"
#include "report/page.h"

namespace binrig {

/// Masks pooled over the captures of a split, one row a model, and by reason for the whole model.
struct ScenePool {
  std::string split;  ///< "train", "test"
  std::vector<MaskScore> scores;
};
std::vector<ScenePool> pool_scenes(const std::vector<SceneFidelity>& scenes, std::uint64_t seed);

/// A sentence about the whole model's masks: explained share, precision.
std::string mask_sentence(const MaskScore& score);

void draw_scenes(Page& page, const std::vector<SceneFidelity>& scenes, const std::vector<ScenePool>& pools,
                 int detailed = 3);

}  // namespace binrig
