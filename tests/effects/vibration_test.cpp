#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(Vibration, FramesAreShiftedAndTiltedAsOneWithTheGivenDeviation) {
  const Camera camera = test::small_camera();
  const CaptureContext context = test::analytic_context(test::plane_scene(800), camera);
  Channels channels;
  channels.depth_mm = cv::Mat(120, 160, CV_32F, cv::Scalar(800));
  test::EffectUnderTest run(test::make_instance("vibration", {{"amplitude", 0.2}}), context);
  double offset_square = 0, tilt_square = 0;
  const int count = 400;
  for (int number = 0; number < count; ++number) {
    const cv::Mat m = run.frame(channels, number).noise_mm;
    const double left = cv::mean(m.col(0))[0], right = cv::mean(m.col(159))[0];
    offset_square += std::pow(cv::mean(m)[0], 2) / count;
    tilt_square += std::pow((right - left) / (2 * 159 / 160.0), 2) / count;
    // A plane: the mixed difference of the corners vanishes, and so does the bend of the middle.
    EXPECT_NEAR(m.at<float>(0, 0) - m.at<float>(0, 159) - m.at<float>(119, 0) + m.at<float>(119, 159), 0, 1e-5);
    EXPECT_NEAR(m.at<float>(0, 0) + m.at<float>(119, 159), m.at<float>(59, 79) + m.at<float>(60, 80), 1e-5);
  }
  // 400 frames: 7 % scatter of a variance. The mean over the image holds the offset alone (x and y average to 0).
  EXPECT_NEAR(offset_square, 0.04, 0.04 * 0.25);
  EXPECT_NEAR(tilt_square, 0.04, 0.04 * 0.25);
}

}  // namespace
}  // namespace binrig
