#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(IntensityBias, DifferenceBetweenTwoAlbedosIsTheLogarithmOfTheirRatio) {
  const auto error = [](double albedo) {
    return cv::Mat(test::depth_under("intensity_bias", {{"coefficient", 0.3}}, test::plane_scene(800, 0, albedo)) -
                   800);
  };
  const cv::Mat difference = error(0.9) - error(0.09);
  const auto [mean, deviation] = test::mean_and_deviation(difference);
  EXPECT_NEAR(mean, 0.3 * std::log(10), 1e-3);
  EXPECT_LT(deviation, 1e-3);  // the same light falls on both
}

TEST(IntensityBias, DarknessIsBounded) {
  // An albedo of 1e-6 counts as the intensity 0.01.
  const cv::Mat depth = test::depth_under("intensity_bias", {{"coefficient", 1}}, test::plane_scene(800, 0, 1e-6));
  EXPECT_NEAR(cv::mean(depth)[0] - 800, std::log(0.01 / 0.4), 1e-3);
}

}  // namespace
}  // namespace binrig
