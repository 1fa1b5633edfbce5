// Captures that would separate two effects, where the answer is known in closed form.
#include "diagnose/advice.h"

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

struct Stage {
  SensorModel plain = noise_alone(0.2);
  SimulationCache cache{""};
  Experiment experiment{campaign().forward(), plain, cache};
  std::vector<SceneMotion> motions =
      scene_motions(experiment, plain, registration_prior(campaign().forward().set(), experiment.nominal(0).camera));
  Rung rung;

  Stage() {
    std::vector<Trial> trials;
    for (int k = 0; k < 12; ++k) trials.push_back({plain, {}, 900 + static_cast<std::uint64_t>(k), Part::all, 3});
    rung.simulations = experiment.simulate(trials);
    rung.standard = Standard(experiment.layout(), rung.simulations[0], rung.simulations);
  }
  SensorModel with(const std::string& effect, std::map<std::string, double> values) const {
    SensorModel model = plain;
    add_effect(model, effect_catalogue(), effect, values);
    return model;
  }
};

TEST(Advice, AnotherDistanceTellsAnOffsetFromAScaleBeyondWhatThePoseMayBe) {
  const Stage stage;
  // They agree at 720 mm. 18 % further away they differ by 18 % of the offset; that is free within pose_sigma.
  const double offset_mm = 6;
  const auto found = captures_that_separate(stage.experiment, stage.motions, stage.rung,
                                            stage.with("depth_offset", {{"offset", offset_mm}}),
                                            {stage.with("depth_scale", {{"scale", offset_mm / 720}})}, 1);
  const auto at_720 = std::find_if(found.begin(), found.end(), [&](const AdvisedCapture& a) {
    return stage.experiment.captures()[a.capture].name == "plane_720" && a.where.pose[5] > 0;
  });
  ASSERT_NE(at_720, found.end());
  EXPECT_NE(at_720->where_to.find("130 mm further away"), std::string::npos) << at_720->where_to;
  // pose_sigma_mm is 0.15: hundreds of bins know their mean far better than that.
  const double expected = std::pow(0.18 * offset_mm / *campaign().forward().set().pose_sigma_mm, 2);
  EXPECT_NEAR(at_720->distance2 / expected, 1, 0.01) << at_720->distance2;
  for (std::size_t i = 1; i < found.size(); ++i) EXPECT_GE(found[i - 1].distance2, found[i].distance2);
}

TEST(Advice, NothingTellsAModelFromItself) {
  const Stage stage;
  const SensorModel model = stage.with("depth_offset", {{"offset", 2}});
  EXPECT_TRUE(captures_that_separate(stage.experiment, stage.motions, stage.rung, model, {model}, 1).empty());
}

}  // namespace
}  // namespace binrig
