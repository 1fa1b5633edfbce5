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

}  // namespace
}  // namespace binrig
