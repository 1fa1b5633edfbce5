#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

double shift_at(double time_s, bool power_on) {
  CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  context.power_on = power_on;
  const auto channels = test::analytic_channels(test::plane_scene(800), context.camera, context.projector_xyz_mm, 800);
  test::EffectUnderTest run(test::make_instance("thermal_drift", {{"amplitude", 0.5}, {"time_constant", 40}}), context);
  const Layers layers = run.frame(*channels, 1, time_s);
  return 200 * 75 / cv::mean(layers.depth_mm)[0] - 200 * 75 / 800.0;  // px
}

TEST(ThermalDrift, DecaysByEInEveryTimeConstant) {
  EXPECT_NEAR(shift_at(0, true), 0.5, 1e-4);
  EXPECT_NEAR(shift_at(40, true) / shift_at(0, true), std::exp(-1), 1e-3);
  EXPECT_NEAR(shift_at(120, true) / shift_at(80, true), std::exp(-1), 1e-3);
}

TEST(ThermalDrift, HappensOnlyInACaptureThatBeginsWithPowerOn) {
  EXPECT_NEAR(shift_at(0, false), 0, 1e-6);
  CaptureContext warm = test::analytic_context(test::plane_scene(800), test::small_camera());
  warm.power_on = false;
  SensorModel model;
  model.effects = {test::make_instance("thermal_drift")};
  const SensorRun run(model, warm);
  ASSERT_EQ(run.inactive().size(), 1u);
  EXPECT_NE(run.inactive()[0].second.find("power-on"), std::string::npos);
}

}  // namespace
}  // namespace binrig
