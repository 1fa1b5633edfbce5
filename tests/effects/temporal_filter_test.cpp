#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

Layers frame_with(float level, int frame) {
  Layers layers;
  layers.depth_mm = cv::Mat(100, 100, CV_32F);
  RandomStream(100 + frame).fill_normal(layers.depth_mm);
  layers.depth_mm += level;
  layers.reason = cv::Mat::zeros(100, 100, CV_8U);
  return layers;
}

TEST(TemporalFilter, VarianceAndLagOneCorrelationAreThoseOfTheRecursion) {
  // Settled: variance a / (2 - a), correlation of neighbours in time 1 - a.
  const double a = 0.4;
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  test::EffectUnderTest run(test::make_instance("temporal_filter", {{"weight", a}}), context);
  cv::Mat before;
  double square = 0, lagged = 0;
  for (int frame = 0; frame < 40; ++frame) {
    Layers layers = frame_with(800, frame);
    if (frame == 0) {
      const cv::Mat first = layers.depth_mm.clone();
      run.apply(layers, Channels{});
      EXPECT_EQ(cv::norm(first, layers.depth_mm, cv::NORM_INF), 0);
    } else {
      run.apply(layers, Channels{}, frame);
    }
    const cv::Mat residual = layers.depth_mm - 800;
    if (frame >= 20) {
      square += residual.dot(residual) / 1e4 / 20;
      lagged += residual.dot(before) / 1e4 / 20;
    }
    before = residual;
  }
  EXPECT_NEAR(square, a / (2 - a), 0.02 * a);  // 200000 values, correlated: 0.5 %
  EXPECT_NEAR(lagged / square, 1 - a, 0.02);
}

TEST(TemporalFilter, StepIsFollowedGeometrically) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  test::EffectUnderTest run(test::make_instance("temporal_filter", {{"weight", 0.3}}), context);
  for (int frame = 0; frame < 6; ++frame) {
    Layers layers = frame_with(0, frame);
    layers.depth_mm.setTo(frame == 0 ? 700 : 800);
    run.apply(layers, Channels{}, frame);
    EXPECT_NEAR(layers.depth_mm.at<float>(5, 5), 800 - 100 * std::pow(0.7, frame), 1e-3);
  }
}

TEST(TemporalFilter, HolesAreThoseOfThePresentFrameAndForgetNothing) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  test::EffectUnderTest run(test::make_instance("temporal_filter", {{"weight", 0.5}}), context);
  Layers hole = frame_with(0, 0), first = hole, third = hole;
  first.depth_mm = cv::Mat(100, 100, CV_32F, 800.f);
  first.reason = hole.reason.clone();
  hole.depth_mm = cv::Mat::zeros(100, 100, CV_32F);
  hole.reason = cv::Mat(100, 100, CV_8U, cv::Scalar(static_cast<int>(Reason::dropped)));
  third.depth_mm = cv::Mat(100, 100, CV_32F, 810.f);
  third.reason = cv::Mat::zeros(100, 100, CV_8U);
  run.apply(first, Channels{}, 0);
  run.apply(hole, Channels{}, 1);
  run.apply(third, Channels{}, 2);
  EXPECT_EQ(cv::countNonZero(hole.reason == static_cast<int>(Reason::dropped)), 10000);
  EXPECT_NEAR(third.depth_mm.at<float>(5, 5), 805, 1e-3);
}

}  // namespace
}  // namespace binrig
