#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

cv::Mat dead(double rate, std::uint64_t unit_seed, std::uint64_t seed, int frame) {
  Camera camera = test::small_camera().resized(400, 400);
  CaptureContext context = test::analytic_context(test::plane_scene(800), camera);
  context.unit_seed = unit_seed;
  context.seed = seed;
  Channels channels;
  channels.depth_mm = cv::Mat(400, 400, CV_32F, cv::Scalar(800));
  return test::EffectUnderTest(test::make_instance("dead_pixels", {{"rate", rate}}), context)
             .frame(channels, frame)
             .reason == static_cast<int>(Reason::defect);
}

TEST(DeadPixels, AreTheSameInEveryCaptureOfAUnitAndOthersInAnother) {
  const cv::Mat map = dead(0.01, 5, 1, 0);
  EXPECT_NEAR(cv::countNonZero(map), 1600, 160);  // 4 sigma of the binomial
  EXPECT_EQ(cv::countNonZero(map != dead(0.01, 5, 77, 3)), 0);
  EXPECT_LT(cv::countNonZero(map & dead(0.01, 6, 1, 0)), 45);  // 16 expected by chance
}

TEST(DeadPixels, HigherRateOnlyAddsPixels) {
  EXPECT_EQ(cv::countNonZero(dead(0.002, 5, 1, 0) & ~dead(0.01, 5, 1, 0)), 0);
}

}  // namespace
}  // namespace binrig
