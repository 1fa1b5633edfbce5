#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(Interreflection, FallsByEOverItsLengthFromTheCreaseAndIsNowhereElse) {
  // The left flank (x = 150 mm) of a box that stands on the plane at 800 mm. The camera looks to the right, so that the
  // crease appears at column 79.5 and the flank gets nearer by only 5 mm a pixel: a crease, not an edge.
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(150, -400, 500), Vector3(400, 400, 800)};
  Camera camera = test::small_camera();
  camera.fx = camera.fy = 800;
  camera.cx = 79.5 - 800 * 150 / 800.0;
  const CaptureContext context = test::analytic_context(scene, camera);
  const auto channels = test::analytic_channels(scene, camera, context.projector_xyz_mm, 800);
  const Layers layers =
      test::EffectUnderTest(test::make_instance("interreflection", {{"amplitude", 2}, {"length", 6}}), context)
          .frame(*channels);
  const cv::Mat error = layers.depth_mm - channels->depth_mm;
  EXPECT_NEAR(error.at<float>(60, 79), 2 * std::exp(-0.5 / 6), 0.01);
  EXPECT_NEAR(error.at<float>(60, 80), 2 * std::exp(-0.5 / 6), 0.01);
  EXPECT_NEAR(error.at<float>(60, 67) / error.at<float>(60, 73), std::exp(-6 / 6.0), 0.01);
  EXPECT_NEAR(error.at<float>(60, 92) / error.at<float>(60, 86), std::exp(-6 / 6.0), 0.01);
  EXPECT_EQ(error.at<float>(60, 5), 0);
}

}  // namespace
}  // namespace binrig
