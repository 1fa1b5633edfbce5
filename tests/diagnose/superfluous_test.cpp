// What was added and does nothing goes out of the model again, wherever it stands; what does something stays.
#include "diagnose/superfluous.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// A ladder on which these were added one after the other.
Climbed ladder(const Case& c, const std::vector<EffectInstance>& effects) {
  Climbed climbed;
  climbed.options.simulations = 8;
  SensorModel model = c.start;
  const auto climb = [&](const std::string& added) {
    climbed.rungs.push_back(fit_rung(c.experiment, c.motions, c.measured, model, {}, climbed.options));
    climbed.added.push_back(added);
    climbed.removed.push_back("");
  };
  climb("");
  for (const EffectInstance& effect : effects) {
    const std::string id = add_effect(model, effect_catalogue(), effect).id;
    CandidateReport report;
    report.effect = effect.effect, report.id = id;
    climbed.candidates.push_back(report);
    climbed.evidence.accepted.push_back({effect.effect, false, true, {}});
    climb(effect.effect);
  }
  return climbed;
}

EffectInstance instance(const std::string& effect, const std::string& parameter, double value) {
  EffectInstance result;
  result.effect = result.id = effect;
  result.values[parameter].value = value;
  return result;
}

TEST(Superfluous, WhatCameLastAndDoesNothingGoes) {
  const Case c(noise_alone(0.3), noise_alone(0.3));
  Climbed climbed = ladder(c, {instance("radial_distortion", "amplitude", 0.05)});
  EXPECT_TRUE(take_out_superfluous(c.experiment, c.motions, c.measured, climbed));
  EXPECT_EQ(climbed.removed.back(), "radial_distortion");
  EXPECT_EQ(climbed.rungs.back().model.find("radial_distortion"), nullptr);
  EXPECT_TRUE(climbed.candidates.empty());
  EXPECT_THAT(climbed.warnings, testing::ElementsAre(testing::HasSubstr("radial_distortion was added and")));
}

TEST(Superfluous, SoDoesWhatCameBeforeAndTheOthersStay) {
  const Case c(model_with("depth_offset", {{"offset", 0.8}}), noise_alone(0.3));
  Climbed climbed =
      ladder(c, {instance("radial_distortion", "amplitude", 0.05), instance("depth_offset", "offset", 0.5)});
  EXPECT_FALSE(take_out_superfluous(c.experiment, c.motions, c.measured, climbed)) << "the last one stays";
  ASSERT_EQ(climbed.candidates.size(), 1u);
  EXPECT_EQ(climbed.candidates[0].effect, "depth_offset");
  EXPECT_EQ(climbed.rungs.back().model.find("radial_distortion"), nullptr);
  EXPECT_NE(climbed.rungs.back().model.find("depth_offset"), nullptr);
  EXPECT_EQ(climbed.evidence.accepted.size(), 1u);
}

TEST(Superfluous, WhatFadesWithWhatCameAfterItGoes) {
  // What frames carry over from those before stays through a capture, like bumps of the scene; but these are all of it
  // only as long as nobody knows of the filter.
  const Case c(model_with("temporal_filter", {{"weight", 0.6}}), noise_alone(0.3), campaign(), 7);
  Climbed climbed =
      ladder(c, {instance("speckle_noise", "amplitude", 0.02), instance("temporal_filter", "weight", 0.5)});
  const double now = climbed.rungs[2].model.find("speckle_noise")->value("amplitude");
  value_in(climbed.rungs[1].model, "speckle_noise", "amplitude").value = 5 * now;
  EXPECT_FALSE(take_out_superfluous(c.experiment, c.motions, c.measured, climbed));
  ASSERT_EQ(climbed.candidates.size(), 1u);
  EXPECT_EQ(climbed.candidates[0].effect, "temporal_filter");
  EXPECT_EQ(climbed.rungs.back().model.find("speckle_noise"), nullptr);
}

TEST(Superfluous, WhatIsInTheInstrumentStays) {
  const Case c(model_with("radial_distortion", {{"amplitude", 0.1}}), noise_alone(0.3));
  Climbed climbed = ladder(c, {instance("radial_distortion", "amplitude", 0.05)});
  EXPECT_FALSE(take_out_superfluous(c.experiment, c.motions, c.measured, climbed));
  EXPECT_EQ(climbed.rungs.size(), 2u);
  EXPECT_TRUE(climbed.warnings.empty());
}

}  // namespace
}  // namespace binrig
