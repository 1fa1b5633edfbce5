// An effect is the same in every capture; what only stands for one is not.
#include "diagnose/capture_by_capture.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// What bands of the catalogue, 0.2 mm and 45 px, want when the real ones move by `turns` periods for every pixel of
/// disparity.
WantedOtherwise wanted_by(double turns) {
  const SensorModel moving = parse_sensor_model(
      fmt::format("name: f\neffects:\n  - formula: {{id: moving, stage: geometry, on: depth, expression: "
                  "\"0.2*cos(6.2832*(u/45 + {}*d))\"}}\n",
                  turns),
      "f", effect_catalogue());
  SensorModel truth = noise_alone(0.3);
  add_effect(truth, effect_catalogue(), moving.effects.at(0));
  const Case c(truth, model_with("column_banding", {{"amplitude", 0.2}, {"period", 45}, {"phase", 0}}));
  return wanted_otherwise(c.experiment.layout(), c.fitted({.simulations = 24}), "column_banding");
}

TEST(CaptureByCapture, BandsThatAreTheSameInAllCapturesAreWantedAsTheyAre) {
  const WantedOtherwise wanted = wanted_by(0);
  EXPECT_GT(wanted.by_chance, 0);
  EXPECT_FALSE(wanted.significant()) << wanted.square << ", by chance " << wanted.by_chance << " +- "
                                     << wanted.deviation;
}

TEST(CaptureByCapture, BandsThatMoveWithTheDistanceAreNone) {
  const WantedOtherwise wanted = wanted_by(0.25);
  EXPECT_TRUE(wanted.significant()) << wanted.square << ", by chance " << wanted.by_chance << " +- "
                                    << wanted.deviation;
}

}  // namespace
}  // namespace binrig
