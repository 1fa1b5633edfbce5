#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(RandomDropout, HolesAreIndependentFromFrameToFrameAndPixelToPixel) {
  const double rate = 0.05;
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  Channels channels;
  channels.depth_mm = cv::Mat(120, 160, CV_32F, cv::Scalar(800));
  test::EffectUnderTest run(test::make_instance("random_dropout", {{"rate", rate}}), context);
  double lost = 0, twice = 0, side_by_side = 0;
  cv::Mat before;
  for (int frame = 0; frame < 41; ++frame) {
    const cv::Mat mask = run.frame(channels, frame).reason == static_cast<int>(Reason::dropped);
    if (!before.empty()) {
      lost += cv::countNonZero(mask) / (40.0 * 19200);
      twice += cv::countNonZero(mask & before) / (40.0 * 19200);
      side_by_side += cv::countNonZero(mask.colRange(0, 159) & mask.colRange(1, 160)) / (40.0 * 159 * 120);
    }
    before = mask;
  }
  // 768000 pixels: 0.5 % scatter of the rate, 2.3 % of its square.
  EXPECT_NEAR(lost, rate, 0.02 * rate);
  EXPECT_NEAR(twice, rate * rate, 0.1 * rate * rate);
  EXPECT_NEAR(side_by_side, rate * rate, 0.1 * rate * rate);
}

}  // namespace
}  // namespace binrig
