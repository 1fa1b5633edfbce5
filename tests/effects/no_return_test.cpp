#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

Layers frame_of(const test::AnalyticSurface& surface, double threshold) {
  test::AnalyticScene scene = test::plane_scene(800, 0.35);
  scene.plane_surface = surface;
  const CaptureContext context = test::analytic_context(scene, test::narrow_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  return test::EffectUnderTest(test::make_instance("no_return", {{"threshold", threshold}}), context).frame(*channels);
}

TEST(NoReturn, PolishedPlaneTiltedAwayIsBlindAndAMattOneIsNot) {
  // Tilted by 20 degrees the mirrored ray passes 40 degrees beside the camera: (R.V)^200 is nothing.
  EXPECT_EQ(test::share_with(frame_of({0.03, 0.9, 200}, 0.05), Reason::low_signal), 1);
  EXPECT_EQ(test::share_with(frame_of({0.4, 0, 1}, 0.05), Reason::low_signal), 0);
}

TEST(NoReturn, HighlightOfAPolishedSphereIsAllThatIsLeft) {
  test::AnalyticScene scene;
  scene.has_plane = false;
  scene.sphere = test::AnalyticScene::Sphere{Vector3(0, 0, 800), 120};
  scene.sphere_surface = {0.01, 0.9, 30};
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  const Layers layers =
      test::EffectUnderTest(test::make_instance("no_return", {{"threshold", 0.1}}), context).frame(*channels);
  EXPECT_EQ(layers.reason.at<std::uint8_t>(59, 81), 0);  // the mirror point
  EXPECT_EQ(layers.reason.at<std::uint8_t>(59, 60), static_cast<int>(Reason::low_signal));
}

}  // namespace
}  // namespace binrig
