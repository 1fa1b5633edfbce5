// Captures that would separate two effects, where the answer is known in closed form.
#include "diagnose/advice.h"

#include <fmt/format.h>
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
  std::string id_added(const SensorModel& model) const {
    return std::ranges::find_if(model.effects, [&](const EffectInstance& e) { return !plain.find(e.id); })->id;
  }
  std::vector<AdvisedCapture> captures(const SensorModel& one, const Fit& fit_of_one, const SensorModel& other,
                                       const Fit& fit_of_other) const {
    return captures_that_separate(experiment, motions, rung, {one, id_added(one), fit_of_one},
                                  {{other, id_added(other), fit_of_other}}, 1);
  }
};

TEST(Advice, AnotherDistanceTellsAnOffsetFromAScaleBeyondWhatThePoseMayBe) {
  const Stage stage;
  // They agree at 720 mm. Elsewhere they differ by a share of the offset; that is free within pose_sigma.
  const double offset_mm = 6;
  const auto found = stage.captures(stage.with("depth_offset", {{"offset", offset_mm}}), {},
                                    stage.with("depth_scale", {{"scale", offset_mm / 720}}), {});
  const auto chart = std::find_if(found.begin(), found.end(), [&](const AdvisedCapture& a) {
    return stage.experiment.captures()[a.capture].name == "chart" && a.where.pose[5] > 0;
  });
  ASSERT_NE(chart, found.end());
  const double further_mm = chart->where.pose[5];
  EXPECT_NE(chart->where_to.find(fmt::format("{:.0f} mm further away", further_mm)), std::string::npos);
  const double distance_mm = cv::mean(stage.experiment.nominal(chart->capture).depth_mm)[0] + further_mm;
  // pose_sigma_mm is 0.15: hundreds of bins know their mean far better than that.
  const double expected = std::pow((distance_mm / 720 - 1) * offset_mm / *campaign().forward().set().pose_sigma_mm, 2);
  EXPECT_NEAR(chart->distance2 / expected, 1, 0.01) << chart->distance2;
  for (std::size_t i = 1; i < found.size(); ++i) EXPECT_GE(found[i - 1].distance2, found[i].distance2);
}

TEST(Advice, WhatTheRecordingLeavesFreeIsFittedToTheNewCaptureToo) {
  const Stage stage;
  const SensorModel offset = stage.with("depth_offset", {{"offset", 6}});
  const SensorModel scale = stage.with("depth_scale", {{"scale", 6.0 / 720}});
  Fit fit;
  fit.parameters = fit_parameters(scale, effect_catalogue(), {stage.id_added(scale)});
  ASSERT_EQ(fit.parameters.size(), 1u);
  // A recording that says nothing of the scale: wherever a plane stands, some scale puts it where the offset does.
  Whitened slope(stage.experiment.layout().size, 0.f);
  fit.slopes = {slope};
  const auto plane_moved = [&](const std::vector<AdvisedCapture>& found) {
    return std::ranges::any_of(found, [&](const AdvisedCapture& a) {
      return stage.experiment.captures()[a.capture].name == "plane_720" && a.where.pose[5] != 0;
    });
  };
  const auto known = stage.captures(offset, {}, scale, {});
  EXPECT_TRUE(plane_moved(known));
  EXPECT_FALSE(plane_moved(stage.captures(offset, {}, scale, fit)));
  // One that knows it to a millionth: as if it were none.
  for (const Block& block : stage.experiment.layout().blocks)
    if (block.train) std::fill_n(slope.begin() + block.offset, block.size, 1e6f);
  fit.slopes = {slope};
  const auto held = stage.captures(offset, {}, scale, fit);
  ASSERT_EQ(held.size(), known.size());
  for (std::size_t i = 0; i < held.size(); ++i) EXPECT_NEAR(held[i].distance2 / known[i].distance2, 1, 1e-3);
}

TEST(Advice, NothingTellsAModelFromItself) {
  const Stage stage;
  const SensorModel model = stage.with("depth_offset", {{"offset", 2}});
  EXPECT_TRUE(stage.captures(model, {}, model, {}).empty());
}

}  // namespace
}  // namespace binrig
