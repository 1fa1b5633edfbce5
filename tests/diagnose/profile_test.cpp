// Values tried one by one: on the small campaign, whose truth is known.
#include "diagnose/profile.h"

#include <gtest/gtest.h>

#include "bench/support/small_campaign.h"
#include "sim/effect.h"

namespace binrig {
namespace {

SensorModel noise_of(double sigma_mm) {
  SensorModel model = parse_sensor_model(
      "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n  - spectral_noise: {}\n",
      "m", effect_catalogue());
  model.effects[0].values["sigma"].value = sigma_mm;
  return model;
}

class ProfileTest : public testing::Test {
 protected:
  static constexpr double truth = 0.3;
  ProfileTest() {
    const auto recording = bench::simulated_recording(forward_, noise_of(truth), bench::drawn_offsets(forward_, 6), 6);
    std::vector<std::string> unreadable;
    measured_ = experiment_.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
    RungOptions options;
    options.simulations = 16;
    options.pose_draws = 4;
    options.passes = 0;  // nothing is fitted: the model is the truth
    motions_ =
        scene_motions(experiment_, noise_of(truth), registration_prior(forward_.set(), experiment_.nominal(0).camera));
    rung_ = fit_rung(experiment_, motions_, measured_, noise_of(truth), {}, options);
    metric_ = Metric(experiment_.layout(), Part::train, motion_rows(experiment_.layout(), rung_.standard, motions_));
    place_.assign(rung_.place.begin(), rung_.place.begin() + static_cast<long>(motions_.size()));
  }

  const bench::SmallCampaign campaign_{true};
  const SceneForwardModel& forward_ = campaign_.forward();
  SimulationCache cache_{""};
  Experiment experiment_{forward_, noise_of(truth), cache_};
  Measurement measured_;
  std::vector<SceneMotion> motions_;
  Rung rung_;
  Metric metric_;
  std::vector<double> place_;
};

TEST_F(ProfileTest, RulesOutWhatIsFarAndHoldsTheTruth) {
  Profile profile(experiment_, motions_, rung_, metric_, place_, false, 77);
  for (const double sigma : {truth, 0.27, 0.29, 0.31, 0.33, 0.4}) profile.ask(sigma, noise_of(sigma));
  EXPECT_GE(profile.limit(), 3.84);
  EXPECT_TRUE(profile.holds(truth));
  EXPECT_FALSE(profile.holds(0.27));
  EXPECT_FALSE(profile.open_below());
  EXPECT_FALSE(profile.open_above());
  const auto [low, high] = profile.interval(0, 10);
  EXPECT_LT(low, truth);
  EXPECT_GT(high, truth);
  EXPECT_GE(low, 0.27);
  EXPECT_LE(high, 0.33);
}

TEST_F(ProfileTest, WhatIsNotRuledOutReachesToTheBound) {
  Profile profile(experiment_, motions_, rung_, metric_, place_, false, 77);
  for (const double sigma : {truth, 0.27}) profile.ask(sigma, noise_of(sigma));
  EXPECT_TRUE(profile.open_above());
  const auto [low, high] = profile.interval(0, 10);
  EXPECT_EQ(low, 0.27);
  EXPECT_EQ(high, 10);
}

TEST_F(ProfileTest, AValueIsSimulatedOnce) {
  Profile profile(experiment_, motions_, rung_, metric_, place_, true, 77);
  const double chi = profile.ask(truth, noise_of(truth));
  const auto simulated = experiment_.simulated();
  EXPECT_EQ(profile.ask(truth, noise_of(truth)), chi);
  EXPECT_EQ(experiment_.simulated(), simulated);
}

}  // namespace
}  // namespace binrig
