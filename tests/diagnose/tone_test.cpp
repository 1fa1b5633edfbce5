// A ring in the spectrum of the noise that is a small part of it: found by what simulations agree on.
#include "diagnose/tone.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

const bench::SmallCampaign& planes() {
  static const bench::SmallCampaign planes = [] {
    bench::Campaign campaign(7);
    constexpr int frames = 6;
    for (const double distance : {700.0, 800.0}) campaign.plane("train", "plane", frames, distance);
    campaign.plane("test", "plane_2", frames, 750);
    return bench::SmallCampaign(campaign, 320);
  }();
  return planes;
}

struct Ring : Case {
  explicit Ring(const SensorModel& truth)
      : Case(truth, noise_alone(0.3), planes()),
        rung(fitted({.simulations = 16})),
        all(make_hypotheses(planes().forward(), start)),
        bumps(*std::ranges::find(all.tested, "noise_bumps", &Hypothesis::effect)) {}

  const Rung rung;
  const Hypotheses all;
  const Hypothesis& bumps;
  const Refiner refiner{experiment, motions, rung, measured, 2, 501, Part::all, 0};
};

TEST(Tone, IsFoundWhereItIsATenthOfTheNoisesPower) {
  const std::map<std::string, double> truth{{"amplitude", 0.09}, {"frequency", 0.12}, {"width", 0.02}};
  const Ring ring(model_with("noise_bumps", truth));
  const LinearGain start{0, 0, {{"amplitude", 0.1}, {"frequency", 0.15}, {"width", 0.015}}};
  const RefinedFit found = refine_tone(ring.refiner, ring.bumps, start);
  const EffectInstance& effect = *found.fit.model.find(found.id);
  for (const auto& [name, value] : truth) {
    const ParameterValue& its = effect.values.at(name);
    ASSERT_TRUE(its.ci95) << name;
    const double half = std::log((*its.ci95)[1] / its.value);
    EXPECT_LT(half, name == "width" ? 1 : 0.4) << name;
    EXPECT_LT(std::abs(std::log(its.value / value)), 2.5 * half) << name << ' ' << its.value;  // five deviations
  }
  const ClearRemainders left = clear_remainders(ring.refiner, found.fit.model);
  EXPECT_GT(left.without.train - left.with.train, 36);
  EXPECT_GT(left.without.test - left.with.test, 9);
}

TEST(Tone, ExplainsNothingWhereThereIsNone) {
  const Ring ring(noise_alone(0.3));
  const SensorModel with = model_with("noise_bumps", {{"amplitude", 0.09}, {"frequency", 0.12}, {"width", 0.02}});
  const ClearRemainders left = clear_remainders(ring.refiner, with);
  EXPECT_GT(left.with.train - left.without.train, 36);
  const ClearRemainders same = clear_remainders(ring.refiner, ring.rung.model);
  EXPECT_EQ(same.with.train, same.without.train);
  EXPECT_EQ(same.with.test, same.without.test);
  const RefinedFit fit =
      refine_tone(ring.refiner, ring.bumps, {0, 0, {{"amplitude", 0.5}, {"frequency", 0.3}, {"width", 0.02}}});
  for (const auto& [name, value] : fit.fit.model.find(fit.id)->values) {
    ASSERT_TRUE(value.ci95) << name;
    EXPECT_TRUE(std::isfinite(value.value) && (*value.ci95)[0] <= value.value && value.value <= (*value.ci95)[1])
        << name;
  }
}

}  // namespace
}  // namespace binrig
