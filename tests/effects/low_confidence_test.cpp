#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(LowConfidence, LeavesTheCapOfASphereThatTheClosedFormSays) {
  // A sphere of radius R at distance D: incidence theta is met where sin(angle off axis) = R sin(theta) / D.
  test::AnalyticScene scene;
  scene.has_plane = false;
  scene.sphere = test::AnalyticScene::Sphere{Vector3(0, 0, 800), 200};
  for (const double threshold_deg : {50.0, 65.0, 75.0}) {
    const cv::Mat depth =
        test::depth_under("low_confidence", {{"threshold", threshold_deg}, {"disturbance", 0}}, scene);
    const double off_axis = std::asin(200 * std::sin(threshold_deg * CV_PI / 180) / 800);
    const double radius_px = 200 * std::tan(off_axis);
    int measured = 0;
    for (int row = 0; row < depth.rows; ++row) {
      for (int col = 0; col < depth.cols; ++col) measured += !std::isnan(depth.at<float>(row, col));
    }
    // A disc's pixel count scatters by about the square root of its rim.
    EXPECT_NEAR(measured, CV_PI * radius_px * radius_px, 2 * std::sqrt(2 * CV_PI * radius_px)) << threshold_deg;
  }
}

TEST(LowConfidence, DisturbanceIsASoftThresholdOfThatWidth) {
  // Across a plane of incidence theta0 the invalid share is P(threshold + s field < theta0); with theta0 = threshold
  // it is 1/2. One plane, all pixels nearly alike: a narrow view.
  Camera narrow = test::small_camera();
  narrow.fx = narrow.fy = 20000;
  const test::AnalyticScene plane = test::plane_scene(800, 70 * CV_PI / 180);
  CaptureContext context = test::analytic_context(plane, narrow);
  const auto channels = test::analytic_channels(plane, narrow, context.projector_xyz_mm, 800);
  const auto share = [&](double threshold) {
    double sum = 0;
    for (int frame = 0; frame < 20; ++frame) {
      const auto instance = test::make_instance(
          "low_confidence", {{"threshold", threshold}, {"disturbance", 3}, {"share", 1}, {"grid", 8}});
      sum += test::share_with(test::EffectUnderTest(instance, context).frame(*channels, frame), Reason::low_confidence);
    }
    return sum / 20;
  };
  EXPECT_NEAR(share(70), 0.5, 0.05);
  EXPECT_GT(share(67), 0.7);  // one deviation below: 0.84 for a Gaussian; the field is only nearly one
  EXPECT_LT(share(73), 0.3);
  EXPECT_LT(share(82), 0.005);
}

TEST(LowConfidence, FarFromTheThresholdItsDisturbanceChangesNothing) {
  // Planes whose incidence is far from the threshold: everything or nothing is left, whatever the field is.
  for (const double tilt_deg : {20.0, 84.0}) {
    Camera narrow = test::small_camera();
    narrow.fx = narrow.fy = 20000;
    const test::AnalyticScene plane = test::plane_scene(800, tilt_deg * CV_PI / 180);
    const CaptureContext context = test::analytic_context(plane, narrow);
    const auto channels = test::analytic_channels(plane, narrow, context.projector_xyz_mm, 800);
    for (const double disturbance : {0.0, 0.5, 1.0}) {
      const auto instance =
          test::make_instance("low_confidence", {{"threshold", 75}, {"disturbance", disturbance}, {"grid", 8}});
      EXPECT_EQ(test::share_with(test::EffectUnderTest(instance, context).frame(*channels, 1), Reason::low_confidence),
                tilt_deg > 75 ? 1 : 0);
    }
  }
}

}  // namespace
}  // namespace binrig
