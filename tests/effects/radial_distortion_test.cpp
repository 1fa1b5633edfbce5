#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(RadialDistortion, IsNothingInTheMiddleAllInTheCornersAndAThirdOnAverage) {
  const double amplitude = 0.2, fb = 200 * 75, z = 800;
  const cv::Mat depth = test::depth_under("radial_distortion", {{"amplitude", amplitude}}, test::plane_scene(z));
  cv::Mat shift;
  cv::divide(fb, depth, shift);
  shift -= fb / z;  // px
  EXPECT_NEAR(shift.at<float>(60, 80), 0, amplitude * 2e-4);
  // Corner pixels lie half a pixel inside the image: r^2 = 1 - 1/w - ... ; 1.5 % of the amplitude.
  for (const cv::Point corner : {cv::Point(0, 0), cv::Point(159, 119)}) {
    EXPECT_NEAR(shift.at<float>(corner), amplitude, 0.02 * amplitude);
  }
  EXPECT_NEAR(cv::mean(shift)[0], amplitude / 3, 0.001 * amplitude);
  EXPECT_NEAR(cv::norm(
                  shift,
                  [&] {
                    cv::Mat f;
                    cv::flip(shift, f, -1);
                    return f;
                  }(),
                  cv::NORM_INF),
              0, 1e-5);
}

}  // namespace
}  // namespace binrig
