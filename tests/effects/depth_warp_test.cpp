#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(DepthWarp, IsNothingAtTheReferenceDistanceAndGrowsFromThere) {
  const test::Values values{{"x_term", 0.01}, {"yy_term", -0.02}};
  EXPECT_NEAR(cv::norm(test::depth_under("depth_warp", values, test::plane_scene(800)),
                       cv::Mat(120, 160, CV_32F, 800.f), cv::NORM_INF),
              0, 1e-3);
  const auto error = [&](double z) {
    return cv::Mat(test::depth_under("depth_warp", values, test::plane_scene(z)) / z - 1);
  };
  const cv::Mat near = error(1000), far = error(1200), before = error(600);
  // Twice as far from z0: twice the relative error; on the other side the opposite one.
  EXPECT_LT(cv::norm(far, 2 * near, cv::NORM_INF), 2e-6);
  EXPECT_LT(cv::norm(before, -near, cv::NORM_INF), 2e-6);
  // At the right edge, middle row: x = 1 - 1/160, y ~ 0; at the top, middle column: y = -0.75.
  EXPECT_NEAR(near.at<float>(60, 159), 0.01 * 0.25, 5e-5);
  EXPECT_NEAR(near.at<float>(0, 80), -0.02 * 0.5625 * 0.25, 1e-4);
}

}  // namespace
}  // namespace binrig
