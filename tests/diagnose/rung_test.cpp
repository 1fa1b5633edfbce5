// Fits of all parameters together, on recordings whose truth is known.
#include "diagnose/rung.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "bench/support/small_campaign.h"
#include "diagnose/registration.h"
#include "sim/effect.h"

namespace binrig {
namespace {

SensorModel wiggling(double amplitude, double wavelength, double phase) {
  SensorModel model = parse_sensor_model(
      "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n  - tof_wiggling: {}\n  - spectral_noise: {sigma: 0.3}\n",
      "m", effect_catalogue());
  auto& values = model.effects[0].values;
  values["amplitude"].value = amplitude, values["wavelength"].value = wavelength, values["phase"].value = phase;
  return model;
}

TEST(FitRung, FollowsAValleyAlongWhichTwoParametersMakeUpForEachOther) {
  // Another wavelength with the phase that goes with it is the same wave at one distance, and nearly so at others:
  // slopes to one side promise nothing long before the bottom.
  const bench::SmallCampaign campaign(true);
  const SceneForwardModel& forward = campaign.forward();
  const SensorModel truth = wiggling(1.8, 396.5, 2.66);
  const auto recording = bench::simulated_recording(forward, truth, bench::drawn_offsets(forward, 5), 5);
  const double z_mm = 700, wavelength = 380;
  const SensorModel start =
      wiggling(1.7, wavelength,
               std::remainder(2.66 + 4 * std::numbers::pi * z_mm * (1 / 396.5 - 1 / wavelength), 2 * std::numbers::pi));
  SimulationCache cache("");
  const Experiment experiment(forward, start, cache);
  std::vector<std::string> unreadable;
  const Measurement measured = experiment.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
  const auto motions =
      scene_motions(experiment, start, registration_prior(forward.set(), experiment.nominal(0).camera));
  const Rung rung = fit_rung(experiment, motions, measured, start, {}, {.simulations = 16});
  const EffectInstance& found = rung.model.effects[0];
  // Within a fifth of the way from the start; chance is a tenth of that.
  EXPECT_NEAR(found.value("wavelength"), 396.5, 3);
  EXPECT_NEAR(std::remainder(found.value("phase") - 2.66, 2 * std::numbers::pi), 0, 0.2);
  EXPECT_NEAR(found.value("amplitude"), 1.8, 0.03);
}

}  // namespace
}  // namespace binrig
