#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(Latency, ApproachingPlaneIsSeenSpeedTimesDelayTooFar) {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.velocity_mm_per_s = Vector3(0, 0, -50);
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  test::EffectUnderTest run(test::make_instance("latency", {{"delay", 0.2}}), context);
  for (int number = 0; number < 4; ++number) {
    const double time_s = 0.1 * number;
    const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800, time_s);
    EXPECT_NEAR(cv::mean(run.frame(*channels, number).depth_mm)[0], 800 - 50 * (time_s - 0.2), 1e-3);
  }
}

TEST(Latency, IsListedWhereNothingMoves) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  SensorModel model;
  model.effects = {test::make_instance("latency")};
  ASSERT_EQ(SensorRun(model, context).inactive().size(), 1u);
}

}  // namespace
}  // namespace binrig
