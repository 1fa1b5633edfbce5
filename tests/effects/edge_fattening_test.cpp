#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// A box 10 mm deep in front of a plane 100 mm behind it, no flanks in view.
test::AnalyticScene floating_box() {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-100, -70, 690), Vector3(100, 70, 700)};
  return scene;
}

TEST(EdgeFattening, BoxGrowsByHalfAWindowOnEachSide) {
  const auto size = [](int half) {
    const cv::Mat depth =
        test::depth_under("edge_fattening", {{"half_window", static_cast<double>(half)}}, floating_box());
    return cv::Size(cv::countNonZero(depth.row(60) < 750), cv::countNonZero(depth.col(80) < 750));
  };
  const cv::Size without = size(0);
  for (int half = 1; half <= 4; ++half) {
    EXPECT_EQ(size(half).width, without.width + 2 * half);
    EXPECT_EQ(size(half).height, without.height + 2 * half);
  }
}

TEST(EdgeFattening, SlopesAndPlanesAwayFromEdgesDoNotChange) {
  const test::AnalyticScene slope = test::plane_scene(800, 0.6);
  EXPECT_EQ(cv::norm(test::depth_under("edge_fattening", {{"half_window", 4}}, slope),
                     test::depth_under("edge_fattening", {{"half_window", 0}}, slope), cv::NORM_INF),
            0);
}

}  // namespace
}  // namespace binrig
