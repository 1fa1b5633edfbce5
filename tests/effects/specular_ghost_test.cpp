#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(SpecularGhost, BendsDepthAroundTheMirrorPointAndNowhereElse) {
  test::AnalyticScene scene;
  scene.has_plane = false;
  scene.sphere = test::AnalyticScene::Sphere{Vector3(0, 0, 800), 150};
  scene.sphere_surface = {0.4, 0.6, 40};
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  const auto error = [&](double amplitude, double scale) {
    const auto instance = test::make_instance("specular_ghost", {{"amplitude", amplitude}, {"scale", scale}});
    return cv::Mat(test::EffectUnderTest(instance, context).frame(*channels).depth_mm - channels->depth_mm);
  };
  const cv::Mat ghost = error(2, 0.6);
  double highest;
  cv::Point place;
  cv::minMaxLoc(ghost, nullptr, &highest, nullptr, &place);
  // At the mirror point specular = ks = the scale; the nearest pixel is up to 0.04 rad off it: cos(0.04)^40 = 0.97.
  EXPECT_NEAR(highest, 2, 0.065);
  // The mirror point: half-way between the directions to camera and projector on the sphere.
  EXPECT_NEAR(place.x, 79.5 + 200 * 150 * std::sin(0.5 * std::atan2(75, 650)) / 650, 1.5);
  EXPECT_NEAR(place.y, 59.5, 1);
  EXPECT_NEAR(ghost.at<float>(59, 45), 0, 1e-3);
  double capped;
  cv::minMaxLoc(error(2, 0.1), nullptr, &capped);
  EXPECT_NEAR(capped, 3, 1e-3);  // 1.5 amplitudes at most
  EXPECT_LT(cv::norm(error(-2, 0.6) + ghost, cv::NORM_INF), 1e-3);
}

}  // namespace
}  // namespace binrig
