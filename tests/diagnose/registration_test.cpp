// What a small motion of a target does to the bias map, said beforehand and simulated.
#include "diagnose/registration.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// Change of the statistics of one capture for a motion by so many prior sigmas, next to without noise.
StatVector simulated_change(const Experiment& experiment, const SensorModel& model, const SceneMotion& motion,
                            double sigmas) {
  std::vector<Trial> trials(2);
  for (Trial& trial : trials) {
    trial.model = model;
    trial.only = {motion.capture};
    trial.offsets.resize(experiment.layout().captures);
  }
  trials[1].offsets[motion.capture].pose[motion.element] = sigmas * motion.sigma;
  auto statistics = experiment.simulate(trials);
  for (std::size_t i = 0; i < statistics[0].size(); ++i) statistics[1][i] -= statistics[0][i];
  return statistics[1];
}

TEST(SceneMotions, SayOfFlatTargetsWhatSimulatingThemElsewhereShowsWhereverBiasIsKnown) {
  const bench::SmallCampaign campaign;  // the quick one has no target that moves
  constexpr double noise_mm = 1e-3, stored_mm = 0.02, sigmas = 6;
  const SensorModel model = noise_alone(noise_mm);
  SimulationCache cache{""};
  const Experiment experiment(campaign.forward(), model, cache);
  const Layout& layout = experiment.layout();
  const auto motions =
      scene_motions(experiment, model, registration_prior(campaign.forward().set(), experiment.nominal(0).camera));
  int moving = 0;
  for (const SceneMotion& motion : motions) {
    if (motion.capture < 0) continue;
    const std::string& name = experiment.captures()[motion.capture].name;
    const bool moves = experiment.context(motion.capture).motion;
    // Of the others a step or a crease passes through pixels.
    if (!moves && name.find("tilt") == std::string::npos && name.find("step") == std::string::npos) continue;
    moving += moves && motion.element == 5;
    const StatVector change = simulated_change(experiment, model, motion, sigmas);
    StatVector said(layout.size, std::nanf(""));
    for (const auto& [element, value] : motion.change) said[element] = static_cast<float>(sigmas * value);
    // Two depths that are stored in steps, the noise that makes them what they are (the same in both, of a target that
    // is elsewhere), and second order: z a^2 of a rotation by a.
    const double turn_rad = motion.element < 3 ? sigmas * motion.sigma : 0;
    const double tolerance_mm = stored_mm + 5 * noise_mm + 1000 * turn_rad * turn_rad;
    const Block& block = *layout.find(motion.capture, "bias");
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      if (std::isnan(change[i])) continue;
      ASSERT_FALSE(std::isnan(said[i])) << name << " element " << motion.element << ", bin " << i - block.offset;
      EXPECT_NEAR(said[i], change[i], tolerance_mm) << name << " element " << motion.element;
    }
  }
  EXPECT_EQ(moving, 2);
}

}  // namespace
}  // namespace binrig
