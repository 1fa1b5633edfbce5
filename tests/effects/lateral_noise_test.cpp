#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(LateralNoise, OnASlopeTheDeviationIsTheSlopeTimesSigma) {
  // Within a pixel the look-up is linear: sigma_z = |dz/du| sigma. A narrow view keeps the slope constant:
  // z = 800 / (1 - x tan a), dz/du = 800 tan a / f = 0.0547 mm a pixel for 54 degrees and f = 20000 px.
  const double tilt = 0.94;
  const test::AnalyticScene plane = test::plane_scene(800, tilt);
  CaptureContext context = test::analytic_context(plane, test::narrow_camera());
  const auto channels = test::analytic_channels(plane, context.camera, context.projector_xyz_mm, 800);
  for (const double sigma : {0.3, 1.0}) {
    const Layers layers =
        test::EffectUnderTest(test::make_instance("lateral_noise", {{"sigma", sigma}}), context).frame(*channels);
    const cv::Mat residual = (layers.depth_mm - channels->depth_mm)(cv::Rect(8, 8, 144, 104));
    const double expected = 800 * std::tan(tilt) / 20000 * sigma;
    // 15000 pixels: 0.6 % scatter; floats at 800 mm resolve 6e-5 mm.
    EXPECT_NEAR(test::mean_and_deviation(residual).second, expected, 0.03 * expected);
    EXPECT_NEAR(test::mean_and_deviation(residual).first, 0, 0.03 * expected);
  }
}

TEST(LateralNoise, FrontalPlaneKeepsItsDepthAndAnEdgeJittersWithoutMixing) {
  test::AnalyticScene scene = test::plane_scene(800);
  EXPECT_LT(cv::norm(test::depth_under("lateral_noise", {{"sigma", 1}}, scene), cv::Mat(120, 160, CV_32F, 800.f),
                     cv::NORM_INF),
            1e-3);
  scene.box = {Vector3(-100, -70, 690), Vector3(100, 70, 700)};
  const cv::Mat depth = test::depth_under("lateral_noise", {{"sigma", 1}}, scene);
  // The box's face lies at 690: every pixel still shows one of the two.
  EXPECT_EQ(cv::countNonZero((depth > 690.01) & (depth < 799.99)), 0);
  // Beside a straight edge, half a pixel away, P(n > 0.5) = 0.31 of the pixels show the other side.
  const int left = static_cast<int>(std::ceil(79.5 - 200 * 100 / 690.0));
  const int swapped = cv::countNonZero(depth(cv::Rect(left - 1, 45, 1, 30)) < 700);
  EXPECT_GT(swapped, 2);
  EXPECT_LT(swapped, 20);
}

}  // namespace
}  // namespace binrig
