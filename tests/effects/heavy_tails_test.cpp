#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(HeavyTails, VarianceAndKurtosisAreThoseOfTheContaminatedNormal) {
  const double rate = 0.05, factor = 4;
  const test::AnalyticScene plane = test::plane_scene(800);
  Camera camera = test::small_camera().resized(320, 240);
  CaptureContext context = test::analytic_context(plane, camera);
  context.depth_scale_mm = 0;
  SensorModel model;
  model.effects = {
      test::make_instance("heavy_tails", {{"rate", rate}, {"factor", factor}}),
      test::make_instance("spectral_noise", {{"sigma", 0.5}, {"white_share", 1}, {"correlation_length", 0}})};
  check_sensor_model(model, effect_catalogue());
  SensorRun run(model, context);
  const auto channels = test::analytic_channels(plane, camera, context.projector_xyz_mm, 800);
  double second = 0, fourth = 0;
  for (int number = 0; number < 8; ++number) {
    FrameInstant instant;
    instant.number = number;
    const cv::Mat residual = run.frame(*channels, instant).depth_mm - channels->depth_mm;
    cv::Mat square = residual.mul(residual);
    second += cv::mean(square)[0] / 8;
    fourth += cv::mean(square.mul(square))[0] / 8;
  }
  const double m2 = 1 + rate * (factor * factor - 1), m4 = 3 * (1 + rate * (std::pow(factor, 4) - 1));
  // 614400 values; the fourth moment is carried by 30000 of them: 2.5 % scatter.
  EXPECT_NEAR(second, 0.25 * m2, 0.02 * 0.25 * m2);
  EXPECT_NEAR(fourth / (second * second), m4 / (m2 * m2), 0.1 * m4 / (m2 * m2));
}

}  // namespace
}  // namespace binrig
