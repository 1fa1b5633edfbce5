// Maps that are drawn anew in each capture: found by where they show, how strong and how fine they are.
#include "diagnose/drawn_map.h"

#include <gtest/gtest.h>

#include "diagnose/map_hypotheses.h"
#include "diagnose/unit_map.h"
#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

using Values = std::map<std::string, double>;

const Values medium{{"hold", 0.316}, {"slant", 0.4}, {"pitch", 5}};

/// The gain that draws of an effect (medium patches) have of a recording, the rung's model being noise alone.
DrawnMap::Gain gain_on(const SensorModel& truth, const char* effect = "fronto_parallel_patches",
                       const Values& values = medium) {
  const Case c(truth, noise_alone(0.3));
  const Rung rung = c.fitted({.simulations = 16, .passes = 1});
  const auto simulate = [&](const SensorModel& model) {
    return c.experiment.simulate(UnitMap::trials_of(rung, model, 77), "");
  };
  SensorModel with = rung.model;
  add_effect(with, effect_catalogue(), effect, values);
  return DrawnMap(c.experiment.layout(), rung, simulate(rung.model), simulate(with)).gain(rung.rest, rung.rest);
}

TEST(DrawnMap, FindsPatchesWithTheirStrength) {
  for (const double factor : {0.6, 1.0, 1.8}) {
    auto values = medium;
    values["hold"] *= factor;
    const DrawnMap::Gain gain = gain_on(model_with("fronto_parallel_patches", values));
    EXPECT_TRUE(gain.alike) << factor;
    EXPECT_GT(gain.train, 200) << factor;
    EXPECT_GT(gain.test, 100) << factor;
    // Of the power; four simulated draws and one measured, some hundred cosines in each ring of each tilted capture.
    // And large residuals are squeezed, which takes more of the stronger.
    EXPECT_NEAR(std::sqrt(gain.strength), factor, 0.25 * factor);
  }
}

TEST(DrawnMap, FindsSpeckleWithItsStrength) {
  const Values one{{"amplitude", 0.1}, {"correlation_length", 3}};
  for (const double factor : {0.6, 1.0, 1.8}) {
    Values values = one;
    values["amplitude"] *= factor;
    const DrawnMap::Gain gain = gain_on(model_with("speckle_noise", values), "speckle_noise", one);
    EXPECT_TRUE(gain.alike) << factor;
    EXPECT_GT(gain.test, 100) << factor;
    EXPECT_NEAR(std::sqrt(gain.strength), factor, 0.25 * factor);
  }
}

TEST(DrawnMap, TellsSpeckleFromPatches) {
  // One shows on every plane, the other where it is tilted: neither has the other's strength in each capture.
  const Values speckle{{"amplitude", 0.1}, {"correlation_length", 3}};
  const SensorModel with_speckle = model_with("speckle_noise", speckle),
                    with_patches = model_with("fronto_parallel_patches", medium);
  EXPECT_GT(gain_on(with_speckle, "speckle_noise", speckle).train, 2 * gain_on(with_speckle).train);
  EXPECT_GT(gain_on(with_patches).train, 2 * gain_on(with_patches, "speckle_noise", speckle).train);
}

TEST(DrawnMap, ExplainsNoiseByNothing) {
  const DrawnMap::Gain gain = gain_on(noise_alone(0.3));
  EXPECT_LT(gain.train, 30);  // what a hypothesis has to gain before anybody looks at it
}

TEST(DrawnMap, IsNotTakenForWhatHasAShapeOfItsOwn) {
  const std::map<std::string, Values> others{
      {"radial_distortion", {{"amplitude", 0.15}}},
      {"depth_scale", {{"scale", 0.004}}},
      {"focal_error", {{"error", 0.02}}},
      {"depth_warp", {{"xx_term", 0.006}}},
  };
  for (const auto& [effect, values] : others) {
    const DrawnMap::Gain gain = gain_on(model_with(effect, values));
    EXPECT_TRUE(!gain.alike || gain.train < 30) << effect << " " << gain.train;
    for (const double length : {1.6, 2.5, 4.4}) {  // those that a search tries
      const DrawnMap::Gain bumps =
          gain_on(model_with(effect, values), "speckle_noise", {{"amplitude", 0.1}, {"correlation_length", length}});
      EXPECT_TRUE(!bumps.alike || bumps.train < 30) << effect << " " << length << " px " << bumps.train;
    }
  }
}

TEST(DrawnMap, IsNotTakenForWhatAllCapturesHaveInCommon) {
  // Bumps of the unit are as bumpy as those of a scene.
  const Values bumps{{"amplitude", 0.15}, {"correlation_length", 3}};
  const DrawnMap::Gain gain = gain_on(model_with("fixed_pattern_noise", bumps), "speckle_noise", bumps);
  EXPECT_GT(gain.train, 200);
  EXPECT_FALSE(gain.alike);
}

/// Does a search begin with speckle of the scene, where the rung's model is noise alone?
bool begins_with_speckle(const SensorModel& truth) {
  const Case c(truth, noise_alone(0.3));
  const Rung rung = c.fitted({.simulations = 16, .passes = 1});
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), rung.model);
  std::erase_if(hypotheses.tested, [](const Hypothesis& h) { return h.effect != "speckle_noise"; });
  std::vector<LinearGain> linear{{0, 0, hypotheses.tested[0].paths[0].atoms[0].values}};
  MapHypotheses maps(c.experiment, rung, c.measured, hypotheses, {}, 77);
  maps.learn(linear);
  return maps.begins_with_draws(0);
}

TEST(DrawnMap, IsNotAskedForWhereTheNoiseIsWrong) {
  EXPECT_TRUE(begins_with_speckle(model_with("speckle_noise", {{"amplitude", 0.1}, {"correlation_length", 3}})));
  // The mean of a capture's frames is smoothed, too, and another one in each capture.
  EXPECT_FALSE(begins_with_speckle(model_with("smoothing", {{"sigma", 1.5}})));
}

TEST(MapHypotheses, AMapThatWasUnlikeIsNotFittedAgain) {
  // What a lens bends is fixed in the image, but no random map.
  const Case c(model_with("radial_distortion", {{"amplitude", 0.5}}), noise_alone(0.3));
  const Rung rung = c.fitted({.simulations = 16, .passes = 1});
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), rung.model);
  std::erase_if(hypotheses.tested, [](const Hypothesis& h) { return h.effect != "fixed_pattern_noise"; });
  const auto learned = [&](const std::set<std::string>& no_maps) {
    MapHypotheses maps(c.experiment, rung, c.measured, hypotheses, no_maps, 77);
    std::vector<LinearGain> linear{{0, 0, hypotheses.tested[0].paths[0].atoms[0].values}};
    maps.learn(linear);
    return maps;
  };
  const MapHypotheses first = learned({});
  ASSERT_TRUE(first.gives_parameters(0));
  EXPECT_FALSE(first.looks_random(0));
  EXPECT_EQ(first.unlike(), std::set<std::string>{"fixed_pattern_noise"});
  const MapHypotheses again = learned(first.unlike());
  EXPECT_FALSE(again.gives_parameters(0));
  EXPECT_EQ(again.unlike(), first.unlike());
}

}  // namespace
}  // namespace binrig
