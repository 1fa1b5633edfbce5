// What a rung's model leaves, and what it makes up.
#include "diagnose/score.h"

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

TEST(NeedlesslyRandom, AModelWhoseUnitsDifferByWhatTheRecordingLacks) {
  const auto patterned = [](double amplitude_mm) {
    return model_with("fixed_pattern_noise", {{"amplitude", amplitude_mm}});
  };
  const auto is_needless = [&](double truth_mm, double model_mm) {
    const Case c(patterned(truth_mm), patterned(model_mm));
    return needlessly_random(c.experiment.layout(), c.fitted({.simulations = 16, .passes = 0}));
  };
  EXPECT_TRUE(is_needless(0.01, 0.5));
  EXPECT_FALSE(is_needless(0.5, 0.5));
  EXPECT_FALSE(is_needless(0.5, 0.01)) << "it lacks something";
}

// Draws that are there must pay for themselves, and draws that are not must not, however small they are beside the
// practical floor.
TEST(ProperScoreWithoutFloorOfBias, IsBestForTheRightModelWhereTheFloorIsAsWideAsTheNoise) {
  const SensorModel plain = noise_alone(0.04);
  SensorModel speckled = plain;
  add_effect(speckled, effect_catalogue(), "speckle_noise", {{"amplitude", 0.02}, {"correlation_length", 6}});
  const auto score = [](const SensorModel& truth, const SensorModel& model) {
    const Case c(truth, model);
    return proper_score_without_floor_of_bias(c.experiment.layout(), c.fitted({.simulations = 16, .passes = 0}));
  };
  EXPECT_LT(score(speckled, speckled), score(speckled, plain));
  EXPECT_LT(score(plain, plain), score(plain, speckled));
}

}  // namespace
}  // namespace binrig
