#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(FlyingPixels, ShareNearTheEdgeAndUniformInBetween) {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-100, -70, 690), Vector3(100, 70, 700)};
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  test::EffectUnderTest run(test::make_instance("flying_pixels", {{"probability", 0.3}, {"width", 1.5}}), context);
  double near = 0, flew = 0, sum = 0, square = 0;
  for (int number = 0; number < 40; ++number) {
    const Layers layers = run.frame(*channels, number);
    for (int row = 0; row < 120; ++row) {
      for (int col = 0; col < 160; ++col) {
        const float z = layers.depth_mm.at<float>(row, col), was = channels->depth_mm.at<float>(row, col);
        near += channels->edge_px.at<float>(row, col) <= 1.5f;
        if (z == was) continue;
        ASSERT_LE(channels->edge_px.at<float>(row, col), 1.5f);
        ASSERT_GE(z, 690);
        ASSERT_LE(z, 800);
        const double share = (z - 690) / 110;
        ++flew;
        sum += share;
        square += share * share;
      }
    }
  }
  // About 40 * 700 pixels near the edge, 8000 of which fly: 0.3 % scatter of the share, 0.0032 of the mean.
  EXPECT_NEAR(flew / near, 0.3, 0.015);
  EXPECT_NEAR(sum / flew, 0.5, 0.02);
  EXPECT_NEAR(square / flew, 1 / 3.0, 0.02);
}

}  // namespace
}  // namespace binrig
