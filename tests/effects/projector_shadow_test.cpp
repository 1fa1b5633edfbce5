#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// A box of 100 mm height in the middle of a plane at 800 mm.
test::AnalyticScene box_on_plane() {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-60, -60, 700), Vector3(60, 60, 800)};
  return scene;
}

Layers shadowed(const Vector3& projector_mm, double bias_mm) {
  CaptureContext context = test::analytic_context(box_on_plane(), test::small_camera());
  context.projector_xyz_mm = projector_mm;
  const auto channels = test::analytic_channels(box_on_plane(), context.camera, projector_mm, 800);
  return test::EffectUnderTest(test::make_instance("projector_shadow", {{"bias", bias_mm}}), context).frame(*channels);
}

/// Columns of the middle row that are in shadow: first and last, or (-1, -1).
std::pair<int, int> shadow_columns(const Layers& layers) {
  std::pair<int, int> span{-1, -1};
  for (int col = 0; col < layers.reason.cols; ++col) {
    if (layers.reason.at<std::uint8_t>(60, col) != static_cast<int>(Reason::shadow)) continue;
    if (span.first < 0) span.first = col;
    span.second = col;
  }
  return span;
}

TEST(ProjectorShadow, LiesOnTheSideAwayFromTheProjectorWithTheClosedFormWidth) {
  // Seen from a projector at x = B, the box's far upper edge at x = -60, z = 700 throws its shadow to
  // x = B + (-60 - B) 800/700 on the plane. The camera sees the plane from the box's edge on: x = -60 * 800/700.
  const double baseline = 75;
  const double tip_mm = baseline + (-60 - baseline) * 800.0 / 700.0, edge_mm = -60 * 800.0 / 700.0;
  const auto [first, last] = shadow_columns(shadowed(Vector3(baseline, 0, 0), 0));
  EXPECT_NEAR(first, 79.5 + 200 * tip_mm / 800, 1.01);  // a pixel is lit or not: one pixel of rim
  EXPECT_NEAR(last, 79.5 + 200 * edge_mm / 800, 1.01);
  const auto [mirror_first, mirror_last] = shadow_columns(shadowed(Vector3(-baseline, 0, 0), 0));
  EXPECT_EQ(mirror_first, 159 - last);
  EXPECT_EQ(mirror_last, 159 - first);
}

TEST(ProjectorShadow, BiasLetsTheRimMeasure) {
  // The gap grows from 0 nowhere: on a flat background it is the distance to the box's top along the ray, about 100 mm.
  const double without = test::share_with(shadowed(Vector3(75, 0, 0), 0), Reason::shadow);
  EXPECT_GT(without, 0.003);
  EXPECT_EQ(test::share_with(shadowed(Vector3(75, 0, 0), 50), Reason::shadow), without);
  EXPECT_EQ(test::share_with(shadowed(Vector3(75, 0, 0), 300), Reason::shadow), 0);
}

TEST(ProjectorShadow, ALightAtTheCameraThrowsNone) {
  EXPECT_EQ(test::share_with(shadowed(Vector3(0, 0, 0), 0), Reason::shadow), 0);
}

}  // namespace
}  // namespace binrig
