#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// Mean column of the invalid pixels beside a box in the middle, and their number.
std::pair<double, int> shadow(double baseline_mm) {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-60, -60, 700), Vector3(60, 60, 800)};
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  const Layers layers =
      test::EffectUnderTest(test::make_instance("second_shadow", {{"baseline", baseline_mm}}), context)
          .frame(*channels);
  double sum = 0;
  int count = 0;
  for (int col = 0; col < 160; ++col) {
    const int in_column = cv::countNonZero(layers.reason.col(col) == static_cast<int>(Reason::second_shadow));
    sum += col * in_column;
    count += in_column;
  }
  return {sum / count, count};
}

TEST(SecondShadow, LiesOnTheSideAwayFromTheSecondViewAndGrowsWithItsDistance) {
  const auto [right, right_count] = shadow(50);
  const auto [left, left_count] = shadow(-50);
  EXPECT_LT(right, 79.5);
  EXPECT_GT(left, 79.5);
  EXPECT_NEAR(right + left, 159, 0.1);
  EXPECT_EQ(right_count, left_count);
  // Width on the plane: B (800/700 - 1) = 7.1 mm = 1.8 px for 50 mm; twice as much for 100 mm; rims are whole pixels.
  EXPECT_GT(shadow(100).second, 1.5 * right_count);
}

TEST(SecondShadow, NeedsAScene) {
  CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  context.render = nullptr;
  EXPECT_ANY_THROW(test::EffectUnderTest(test::make_instance("second_shadow"), context));
}

}  // namespace
}  // namespace binrig
