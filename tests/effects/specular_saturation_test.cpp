#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

test::AnalyticScene shiny_sphere() {
  test::AnalyticScene scene;
  scene.has_plane = false;
  scene.sphere = test::AnalyticScene::Sphere{Vector3(0, 0, 800), 120};
  scene.sphere_surface = {0.4, 0.9, 10};
  return scene;
}

Layers saturated(const test::Values& values, int frame = 0) {
  const CaptureContext context = test::analytic_context(shiny_sphere(), test::small_camera());
  const auto channels = test::analytic_channels(shiny_sphere(), context.camera, context.projector_xyz_mm, 800);
  return test::EffectUnderTest(test::make_instance("specular_saturation", values), context).frame(*channels, frame);
}

TEST(SpecularSaturation, HoleLiesAtTheMirrorPointAndHasTheClosedFormSize) {
  // On a sphere far away the mirrored ray turns by 2 angle(normal, bisector): specular = ks cos(2 a)^n, so that the
  // hole is the cap with a < acos((t/ks)^(1/n)) / 2 about the bisector of camera and projector.
  const double threshold = 0.5;
  const Layers layers = saturated({{"threshold", threshold}, {"disturbance", 0}});
  const cv::Mat hole = layers.reason == static_cast<int>(Reason::saturated);
  const cv::Moments moments = [&] {
    cv::Moments m;
    for (int row = 0; row < hole.rows; ++row) {
      for (int col = 0; col < hole.cols; ++col) {
        if (!hole.at<std::uint8_t>(row, col)) continue;
        m.m00 += 1;
        m.m10 += col;
        m.m01 += row;
      }
    }
    return m;
  }();
  ASSERT_GT(moments.m00, 50);
  // Bisector of the directions to camera (0, 0) and projector (75, 0) from the sphere's top at about (0, 0, 680):
  // half of atan(75/680) to the projector's side.
  const double bisector = 0.5 * std::atan2(75, 680);
  const double half_cap = 0.5 * std::acos(std::pow(threshold / 0.9, 1 / 10.0));
  const double px_per_rad = 200 * 120.0 / 680;
  EXPECT_NEAR(moments.m10 / moments.m00, 79.5 + px_per_rad * std::sin(bisector), 0.6);
  EXPECT_NEAR(moments.m01 / moments.m00, 59.5, 0.3);
  // Rays to camera and projector are not parallel over the cap, which makes the hole smaller: dir to the viewer turns
  // with the surface point by about R/680 of the normal's angle on both rays.
  const double radius_px = std::sqrt(moments.m00 / CV_PI);
  EXPECT_NEAR(radius_px, px_per_rad * half_cap / (1 + 120.0 / 680), 0.08 * radius_px + 0.3);
}

TEST(SpecularSaturation, DisturbedRimChangesFromFrameToFrameAndTheMiddleDoesNot) {
  const Layers a = saturated({{"disturbance", 0.1}}, 0), b = saturated({{"disturbance", 0.1}}, 1);
  const Layers still = saturated({{"disturbance", 0.1}, {"share", 0}}, 0);
  EXPECT_GT(cv::countNonZero(a.reason != b.reason), 5);
  EXPECT_EQ(cv::countNonZero(still.reason != saturated({{"disturbance", 0.1}, {"share", 0}}, 1).reason), 0);
  const cv::Mat middle = saturated({{"threshold", 0.88}, {"disturbance", 0}}).reason == int(Reason::saturated);
  EXPECT_EQ(cv::countNonZero(middle & (a.reason == 0)), 0);
}

TEST(SpecularSaturation, QuinticWeightGivesAnotherField) {
  const CaptureContext context = test::analytic_context(shiny_sphere(), test::small_camera());
  const auto channels = test::analytic_channels(shiny_sphere(), context.camera, context.projector_xyz_mm, 800);
  const auto with = [&](const char* weight) {
    const auto instance = test::make_instance("specular_saturation", {{"disturbance", 0.2}}, {{"weight", weight}});
    return test::EffectUnderTest(instance, context).frame(*channels).reason;
  };
  EXPECT_GT(cv::countNonZero(with("cubic") != with("quintic")), 0);
}

}  // namespace
}  // namespace binrig
