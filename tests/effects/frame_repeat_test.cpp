#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(FrameRepeat, ShareOfIdenticalFramesIsTheProbability) {
  CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  context.frames = 1000;
  test::EffectUnderTest run(test::make_instance("frame_repeat", {{"probability", 0.25}}), context);
  int repeats = 0;
  float before = 0;
  for (int frame = 0; frame < 1000; ++frame) {
    Layers layers;
    layers.depth_mm = cv::Mat(4, 4, CV_32F, cv::Scalar(800 + frame));
    layers.reason = cv::Mat(4, 4, CV_8U, cv::Scalar(frame % 3));
    run.apply(layers, Channels{}, frame);
    const float z = layers.depth_mm.at<float>(1, 1);
    repeats += z == before;
    EXPECT_EQ(layers.reason.at<std::uint8_t>(1, 1), static_cast<int>(z - 800) % 3)
        << "depth and reason belong together";
    before = z;
  }
  EXPECT_NEAR(repeats, 250, 55);  // 4 sigma of a binomial of 999
}

}  // namespace
}  // namespace binrig
