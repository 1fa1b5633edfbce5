// What bias goes with on captures held out, when its squares together are as they should be.
#include "diagnose/screen.h"

#include <gtest/gtest.h>

#include "diagnose/diagnose.h"
#include "diagnose/score.h"
#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// A recording by `truth`, looked at by a model that knows all of it but a formula.
struct Look {
  explicit Look(const SensorModel& truth, const SensorModel& model)
      : seen(truth, model), rung(seen.fitted({.simulations = 24, .passes = 0})) {}
  bool goes_with_something() const { return bias_goes_with_something(seen.experiment, rung, seen.measured.all); }
  bool squares_tell() const {
    const Leftovers left = unexplained(seen.experiment.layout(), rung);
    return left.contains({"bias", true}) || left.contains({"bias", false});
  }
  const Case seen;
  const Rung rung;
};

SensorModel with_pattern(SensorModel model, const std::string& expression) {
  const SensorModel formula = parse_sensor_model(
      "name: f\neffects:\n  - formula: {stage: geometry, on: depth, expression: \"" + expression + "\"}\n", "f",
      effect_catalogue());
  add_effect(model, effect_catalogue(), formula.effects.at(0));
  return model;
}

TEST(BiasGoesWithSomething, APatternFarBelowTheNoiseOfACell) {
  const SensorModel model = noise_alone(0.3);
  const Look look(with_pattern(model, "0.06*cos(7*x)*cos(6*y)"), model);
  EXPECT_FALSE(look.squares_tell());
  EXPECT_TRUE(look.goes_with_something());
}

TEST(BiasGoesWithSomething, NotWhereNothingIsMissing) {
  const SensorModel model = noise_alone(0.3);
  const Look look(model, model);
  EXPECT_FALSE(look.goes_with_something());
}

// Every unit has another map: that all captures of one have it in common is what the model says.
TEST(BiasGoesWithSomething, NotWithTheMapOfAnotherUnit) {
  const SensorModel model = model_with("fixed_pattern_noise", {{"amplitude", 0.1}, {"correlation_length", 6}});
  const Look look(model, model);
  EXPECT_FALSE(look.goes_with_something());
}

/// What `diagnose` says without looking for any effect.
Diagnosis judged(const SensorModel& truth, const SensorModel& model) {
  const Case seen(truth, model);
  SimulationCache cache("");
  DiagnosisOptions options;
  options.simulations = 24;
  options.most_effects = 0;
  return diagnose(
      seen.experiment.forward(), [&](int capture, int frame) { return seen.recording[capture][frame]; }, model, cache,
      options);
}

TEST(BiasGoesWithSomething, IsUnexplainedInTheVerdict) {
  const SensorModel model = noise_alone(0.3);
  const Diagnosis with = judged(with_pattern(model, "0.06*cos(7*x)*cos(6*y)"), model);
  EXPECT_EQ(with.verdict, Verdict::unknown_effect) << with.headline;
  ASSERT_EQ(with.unexplained.size(), 1);
  EXPECT_EQ(with.unexplained[0].segment, "bias");
  EXPECT_EQ(judged(model, model).verdict, Verdict::nothing_missing);
}

}  // namespace
}  // namespace binrig
