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

// Where depth is wrong depends on depth, and that is the depth of then.
TEST(Latency, ErrorsOfDepthAreThoseOfTheSceneThatIsSeenThoughTheyWereInTheModelBefore) {
  constexpr float speed_mm_s = 50, delay_s = 0.2;
  test::AnalyticScene moving = test::plane_scene(800), then = test::plane_scene(800 + speed_mm_s * delay_s);
  moving.velocity_mm_per_s = Vector3(0, 0, -speed_mm_s);
  SensorModel locking;
  locking.effects = {test::make_instance("pixel_locking", {{"amplitude", 0.2}})};
  SensorModel late = locking;
  add_effect(late, effect_catalogue(), "latency", {{"delay", delay_s}});
  const auto first_frame = [](const SensorModel& model, const test::AnalyticScene& scene) {
    const CaptureContext context = test::analytic_context(scene, test::small_camera());
    const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800, 0);
    return SensorRun(model, context).frame(*channels, {}).depth_mm;
  };
  EXPECT_LT(cv::norm(first_frame(late, moving), first_frame(locking, then), cv::NORM_INF), 1e-3);
}

TEST(Latency, IsListedWhereNothingMoves) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  SensorModel model;
  model.effects = {test::make_instance("latency")};
  ASSERT_EQ(SensorRun(model, context).inactive().size(), 1u);
}

}  // namespace
}  // namespace binrig
