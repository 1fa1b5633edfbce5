#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

Layers with_disc(int radius) {
  Channels channels;
  channels.depth_mm = cv::Mat(120, 160, CV_32F, cv::Scalar(800));
  channels.depth_mm.colRange(80, 160).setTo(700);
  Layers layers = test::fresh_layers(channels);
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      if (std::hypot(row - 60, col - 40) > radius) continue;
      layers.reason.at<std::uint8_t>(row, col) = static_cast<int>(Reason::saturated);
      layers.depth_mm.at<float>(row, col) = 0;
    }
  }
  return layers;
}

Layers filled(Layers layers, int reach) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  test::EffectUnderTest(test::make_instance("hole_filling", {{"reach", static_cast<double>(reach)}}), context)
      .apply(layers, Channels{});
  return layers;
}

TEST(HoleFilling, HoleShrinksByItsReachAndSmallOnesVanish) {
  EXPECT_EQ(cv::countNonZero(filled(with_disc(4), 5).reason), 0);
  Layers layers = filled(with_disc(10), 4);
  // A disc of radius 10 less 4: rim pixels scatter the count by about the rim's length.
  EXPECT_NEAR(cv::countNonZero(layers.reason), CV_PI * 36, 2 * CV_PI * 6);
  layers.depth_mm.setTo(800, layers.reason != 0);
  EXPECT_EQ(cv::norm(layers.depth_mm.colRange(0, 80), cv::Mat(120, 80, CV_32F, 800.f), cv::NORM_INF), 0);
}

TEST(HoleFilling, EachSideOfAHoleKeepsItsOwnDepth) {
  Layers layers = with_disc(-1);
  layers.reason.colRange(76, 84).setTo(static_cast<int>(Reason::shadow));
  const Layers result = filled(layers, 6);
  EXPECT_EQ(result.depth_mm.at<float>(50, 79), 800);
  EXPECT_EQ(result.depth_mm.at<float>(50, 80), 700);
  EXPECT_EQ(cv::countNonZero(result.reason), 0);
}

}  // namespace
}  // namespace binrig
