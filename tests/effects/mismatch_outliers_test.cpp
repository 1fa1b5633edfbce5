#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(MismatchOutliers, RateAndDistanceAreAsGivenOnBothSides) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  const auto channels = test::analytic_channels(test::plane_scene(800), context.camera, context.projector_xyz_mm, 800);
  test::EffectUnderTest run(test::make_instance("mismatch_outliers", {{"rate", 0.01}, {"distance", 30}}), context);
  int up = 0, down = 0;
  for (int number = 0; number < 20; ++number) {
    const cv::Mat depth = run.frame(*channels, number).depth_mm;
    up += cv::countNonZero(abs(depth - 830) < 1e-2);
    down += cv::countNonZero(abs(depth - 770) < 1e-2);
    EXPECT_EQ(cv::countNonZero(abs(depth - 800) < 1e-2) + cv::countNonZero(abs(abs(depth - 800) - 30) < 1e-2), 19200);
  }
  // 384000 pixels, 1920 +- 44 expected on each side.
  EXPECT_NEAR(up, 1920, 180);
  EXPECT_NEAR(down, 1920, 180);
}

TEST(MismatchOutliers, HigherRateKeepsTheOutliersThatWereThere) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  const auto channels = test::analytic_channels(test::plane_scene(800), context.camera, context.projector_xyz_mm, 800);
  const auto outliers = [&](double rate) {
    const cv::Mat depth = test::EffectUnderTest(test::make_instance("mismatch_outliers", {{"rate", rate}}), context)
                              .frame(*channels)
                              .depth_mm;
    return cv::Mat(abs(depth - 800) > 1);
  };
  const cv::Mat few = outliers(0.002), many = outliers(0.02);
  EXPECT_EQ(cv::countNonZero(few & ~many), 0);
  EXPECT_GT(cv::countNonZero(many), 5 * cv::countNonZero(few));
}

}  // namespace
}  // namespace binrig
