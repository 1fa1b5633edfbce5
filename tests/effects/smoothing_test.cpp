#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

void smooth(Layers& layers, double sigma) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  test::EffectUnderTest(test::make_instance("smoothing", {{"sigma", sigma}}), context).apply(layers, Channels{});
}

Layers flat() {
  Channels channels;
  channels.depth_mm = cv::Mat(120, 160, CV_32F, cv::Scalar(800));
  return test::fresh_layers(channels);
}

TEST(Smoothing, StepBecomesTheErrorFunction) {
  Layers layers = flat();
  layers.depth_mm.colRange(80, 160).setTo(850);
  smooth(layers, 2);
  for (int col = 72; col < 88; ++col) {
    const double expected = 800 + 50 * 0.5 * std::erfc(-(col - 79.5) / 2 / std::sqrt(2.0));
    // Samples for the integral of a Gaussian: the midpoint rule is off by at most 0.242 / (24 sigma^2) of the step.
    EXPECT_NEAR(layers.depth_mm.at<float>(60, col), expected, 50 * 0.242 / (24 * 4) + 0.01) << col;
  }
}

TEST(Smoothing, WhiteNoiseShrinksByTwoRootPiSigma) {
  Layers layers = flat();
  cv::Mat noise(120, 160, CV_32F);
  RandomStream(2).fill_normal(noise);
  layers.depth_mm += noise;
  smooth(layers, 1.5);
  // 1 / (2 sqrt(pi) sigma) of the deviation; 19200 / (4 pi sigma^2) = 680 patches: 2.7 % scatter.
  EXPECT_NEAR(test::mean_and_deviation(layers.depth_mm).second, 1 / (2 * std::sqrt(CV_PI) * 1.5), 0.1 * 0.188);
}

TEST(Smoothing, HolesDoNotPullTheirRim) {
  Layers layers = flat();
  layers.reason(cv::Rect(40, 40, 20, 20)).setTo(static_cast<int>(Reason::shadow));
  layers.depth_mm(cv::Rect(40, 40, 20, 20)).setTo(0);
  smooth(layers, 2);
  layers.depth_mm.setTo(800, layers.reason != 0);
  EXPECT_LT(cv::norm(layers.depth_mm, cv::Mat(120, 160, CV_32F, 800.f), cv::NORM_INF), 1e-3);
}

}  // namespace
}  // namespace binrig
