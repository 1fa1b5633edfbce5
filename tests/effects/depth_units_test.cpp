#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "sim/effect.h"

namespace binrig {
namespace {

cv::Mat after(double step, const cv::Mat& depth, const cv::Mat& reason) {
  EffectInstance instance;
  instance.effect = instance.id = "depth_units";
  instance.values["step"].value = step;
  CaptureContext context;
  const auto run = find_effect("depth_units")->begin(instance, context);
  Layers layers;
  layers.depth_mm = depth.clone();
  layers.reason = reason.clone();
  run->apply(layers, Channels{}, {});
  EXPECT_EQ(cv::norm(layers.reason, reason, cv::NORM_INF), 0);
  return layers.depth_mm;
}

TEST(DepthUnits, EveryDepthIsTheNearestMultiple) {
  cv::Mat depth(20, 30, CV_32F);
  cv::randu(depth, 500, 1200);
  const cv::Mat reason = cv::Mat::zeros(20, 30, CV_8U);
  for (double step : {0.02, 0.3, 7.0}) {
    const cv::Mat rounded = after(step, depth, reason);
    for (int i = 0; i < 600; ++i) {
      const double steps = rounded.at<float>(i) / step;
      // Single precision of depth: 1200 mm has 6e-5 mm.
      EXPECT_NEAR(steps, std::round(steps), 1e-4 / step);
      EXPECT_LE(std::abs(rounded.at<float>(i) - depth.at<float>(i)), step / 2 + 1e-4);
    }
  }
}

TEST(DepthUnits, NeutralAndInvalidPixelsStay) {
  cv::Mat depth(2, 2, CV_32F, cv::Scalar(801.37f));
  cv::Mat reason = cv::Mat::zeros(2, 2, CV_8U);
  EXPECT_EQ(cv::norm(after(0, depth, reason), depth, cv::NORM_INF), 0);
  depth.at<float>(0, 1) = 0;
  reason.at<std::uint8_t>(0, 1) = static_cast<std::uint8_t>(Reason::shadow);
  EXPECT_EQ(after(10, depth, reason).at<float>(0, 1), 0);
  EXPECT_EQ(after(10, depth, reason).at<float>(0, 0), 800);
}

}  // namespace
}  // namespace binrig
