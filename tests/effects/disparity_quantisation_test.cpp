#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "sim/effect.h"

namespace binrig {
namespace {

struct Quantiser {
  EffectInstance instance;
  CaptureContext context;
  explicit Quantiser(double step) {
    instance.effect = instance.id = "disparity_quantisation";
    instance.values["step"].value = step;
    context.camera = camera_from_field_of_view(320, 240, 0.8);
    context.projector_xyz_mm = Vector3(75, 0, 0);
  }
  cv::Mat operator()(const cv::Mat& depth) const {
    const auto run = find_effect("disparity_quantisation")->begin(instance, context);
    Layers layers;
    layers.depth_mm = depth.clone();
    layers.reason = cv::Mat::zeros(depth.size(), CV_8U);
    run->apply(layers, Channels{}, {});
    return layers.depth_mm;
  }
};

TEST(DisparityQuantisation, DisparityComesInSteps) {
  const Quantiser quantise(0.125);
  const double focal_baseline = quantise.context.focal_baseline();
  cv::Mat depth(30, 30, CV_32F);
  cv::randu(depth, 400, 4000);
  const cv::Mat after = quantise(depth);
  for (int i = 0; i < 900; ++i) {
    const double steps = focal_baseline / after.at<float>(i) / 0.125;
    EXPECT_NEAR(steps, std::round(steps), 1e-4 * steps);
    EXPECT_LE(std::abs(focal_baseline / after.at<float>(i) - focal_baseline / depth.at<float>(i)), 0.0625 + 1e-4);
  }
}

TEST(DisparityQuantisation, StepsGrowWithTheSquareOfTheDistance) {
  const Quantiser quantise(0.125);
  const auto step_at = [&](float z) {
    cv::Mat ramp(1, 2000, CV_32F);
    for (int i = 0; i < 2000; ++i) ramp.at<float>(i) = z + 0.05f * i;
    const cv::Mat after = quantise(ramp);
    double first = 0, last = 0;
    int changes = 0;
    for (int i = 1; i < 2000; ++i) {
      if (after.at<float>(i) == after.at<float>(i - 1)) continue;
      if (changes++ == 0) first = after.at<float>(i);
      last = after.at<float>(i);
    }
    return (last - first) / (changes - 1);
  };
  // Mean distance of the ramps is z + 50; the law holds to the next order, step/z < 2 %.
  EXPECT_NEAR(step_at(1150) / step_at(550), 4, 0.15);
}

TEST(DisparityQuantisation, FarBeyondTheLastStepDepthStaysFinite) {
  const Quantiser quantise(0.5);
  const cv::Mat after = quantise(cv::Mat(1, 1, CV_32F, cv::Scalar(1e7)));
  EXPECT_NEAR(after.at<float>(0), quantise.context.focal_baseline() / 0.5, 1);
}

TEST(DisparityQuantisation, NeutralChangesNothingAndAnUnknownBaselineIsAnError) {
  cv::Mat depth(3, 3, CV_32F, cv::Scalar(812.34));
  EXPECT_EQ(cv::norm(Quantiser(0)(depth), depth, cv::NORM_INF), 0);
  Quantiser blind(0.1);
  blind.context.projector_xyz_mm.reset();
  EXPECT_THROW(blind(depth), Error);
}

}  // namespace
}  // namespace binrig
