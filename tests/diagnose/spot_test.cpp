// Where most is left in the image: residuals that are made by hand.
#include "diagnose/spot.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

struct Stage {
  SimulationCache cache{""};
  Experiment experiment{campaign().forward(), noise_alone(0.2), cache};
  Whitened rest = Whitened(experiment.layout().size);

  Stage() {
    std::mt19937 random(7);
    std::normal_distribution<float> normal;
    for (float& y : rest) y = normal(random);
  }
  /// Multiplies what is left in a map's cells, of train captures or of one capture.
  void scale(const std::string& segment, float by, std::optional<int> capture, std::optional<int> cell) {
    for (const Block& block : experiment.layout().blocks) {
      if (segments()[block.segment].name != segment || !block.train || block.rows == 1) continue;
      if (capture && block.capture != *capture) continue;
      for (int i = 0; i < block.size; ++i)
        if (!cell || i == *cell) rest[block.offset + i] *= by;
    }
  }
};

TEST(Spot, IsWhereMostIsLeftInAllCapturesTogether) {
  Stage stage;
  const auto chance = spot_left(stage.experiment, stage.rest);
  ASSERT_TRUE(chance);
  const auto map = std::find_if(stage.experiment.layout().blocks.begin(), stage.experiment.layout().blocks.end(),
                                [](const Block& b) { return segments()[b.segment].name == "drop-out" && b.train; });
  const int row = map->rows / 3, col = 2 * map->cols / 3, cell = row * map->cols + col;
  for (int i : {cell, cell + 1, cell + map->cols}) stage.scale("drop-out", i == cell ? 4 : 3, {}, i);
  const auto spot = spot_left(stage.experiment, stage.rest);
  ASSERT_TRUE(spot);
  EXPECT_GT(spot->stands_out, 2 * chance->stands_out);
  const Camera& camera = stage.experiment.context(0).camera;
  const double side = std::ceil(static_cast<double>(camera.width) / map->cols);
  EXPECT_NEAR(spot->cell, 2 * side / camera.width, 1e-9);
  EXPECT_NEAR(spot->x, ((col + 0.5) * side - 0.5 - camera.cx) / (camera.width / 2.0), 1e-9);
  EXPECT_NEAR(spot->y, ((row + 0.5) * side - 0.5 - camera.cy) / (camera.width / 2.0), 1e-9);
}

TEST(Spot, ATraceAllOverTheImageDoesNotStandOut) {
  Stage stage;
  const double chance = spot_left(stage.experiment, stage.rest)->stands_out;
  stage.scale("bias", 10, {}, {});
  EXPECT_LT(spot_left(stage.experiment, stage.rest)->stands_out, 2 * chance);
}

}  // namespace
}  // namespace binrig
