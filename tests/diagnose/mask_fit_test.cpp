// Masks in the wrong one of two valleys.
#include "diagnose/mask_fit.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "bench/support/small_campaign.h"
#include "diagnose/score.h"
#include "sim/effect.h"

namespace binrig {
namespace {

const bench::SmallCampaign& campaign() {
  static const bench::SmallCampaign campaign(true);
  return campaign;
}

SensorModel highlights(double threshold, double disturbance) {
  SensorModel model = parse_sensor_model(
      "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n  - specular_saturation: {}\n  - spectral_noise: {sigma: 0.3}\n",
      "m", effect_catalogue());
  value_in(model, "specular_saturation", "threshold").value = threshold;
  value_in(model, "specular_saturation", "disturbance").value = disturbance;
  return model;
}

/// A recording of one model, and a rung that has another one.
struct Fitted {
  Fitted(const SensorModel& truth, const SensorModel& model) : experiment(campaign().forward(), model, cache) {
    const std::vector<Offset> nominal(campaign().forward().captures().size());
    const auto recording = bench::simulated_recording(campaign().forward(), truth, nominal, 5);
    std::vector<std::string> unreadable;
    measured = experiment.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
    motions =
        scene_motions(experiment, model, registration_prior(campaign().forward().set(), experiment.nominal(0).camera));
    rung = fit_rung(experiment, motions, measured, model, {}, options);
  }
  bool fit_masks(const SensorModel& given) {
    return binrig::fit_masks(experiment, motions, measured, given, options, rung);
  }
  double score() const { return proper_score(experiment.layout(), rung, Part::train); }

  const RungOptions options{.simulations = 24, .passes = 0};
  SimulationCache cache{""};
  const Experiment experiment;
  Measurement measured;
  std::vector<SceneMotion> motions;
  Rung rung;
};

TEST(FitMasks, LeavesTheValleyOfAnEdgeThatIsTooSharp) {
  const SensorModel truth = highlights(0.57, 0.08), wrong = highlights(0.6, 0.01), given = highlights(0.6, 0.05);
  Fitted fitted(truth, wrong);
  const double before = fitted.score();
  ASSERT_TRUE(fitted.fit_masks(given));
  EXPECT_LT(fitted.score(), before);
  const auto found = [&](const char* name) { return fitted.rung.model.find("specular_saturation")->value(name); };
  EXPECT_LT(std::abs(std::log(found("disturbance") / 0.08)), 0.5 * std::log(0.08 / 0.01));
  EXPECT_LT(std::abs(found("threshold") - 0.57), 0.03);  // nearer than it was, and than what was given
}

TEST(FitMasks, LeavesARightModelAlone) {
  const SensorModel truth = highlights(0.57, 0.08);
  Fitted fitted(truth, truth);
  fitted.fit_masks(highlights(0.6, 0.05));
  // What a few simulations like better may be taken, but never one that the score of all of them does not.
  Fitted as_it_was(truth, truth);
  EXPECT_LE(fitted.score(), as_it_was.score());
}

TEST(MaskThatMayStandElsewhere, IsOneThatExplainsAllCapturesWhereTheUserPutIt) {
  const SensorModel truth = highlights(0.45, 0.05);
  const Fitted fitted(truth, highlights(0.8, 0.02));
  const auto fits = goodness_of_fit(fitted.experiment.layout(), fitted.rung);
  ASSERT_TRUE(std::ranges::any_of(fits, &SegmentFit::significant));
  const auto found = [&](const SensorModel& given) {
    return mask_that_may_stand_elsewhere(fitted.experiment, fitted.motions, fitted.measured, given, fitted.options,
                                         fitted.rung);
  };
  EXPECT_EQ(found(truth), "specular_saturation");
  EXPECT_EQ(found(highlights(0.95, 0.02)), std::nullopt);  // even less is cleared there
  EXPECT_EQ(found(highlights(0.8, 0.02)), std::nullopt);   // it stands there already
}

}  // namespace
}  // namespace binrig
