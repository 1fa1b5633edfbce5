// Where targets stand when a shift is too small for their surfaces to show.
#include "diagnose/edge_registration.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "bench/support/small_campaign.h"
#include "diagnose/score.h"
#include "sim/effect.h"

namespace binrig {
namespace {

const bench::SmallCampaign& campaign() {
  static const bench::SmallCampaign campaign;  // the quick one has no bin
  return campaign;
}

SensorModel plain_model() {
  return parse_sensor_model(
      "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n  - projector_shadow: {}\n  - spectral_noise: {sigma: 0.3}\n",
      "m", effect_catalogue());
}

int capture_of(const std::string& name) {
  for (std::size_t c = 0; c < campaign().forward().captures().size(); ++c)
    if (campaign().forward().captures()[c].name.find(name) != std::string::npos) return static_cast<int>(c);
  return -1;
}

/// A recording of the right model one target of which stands elsewhere by `shift_mm` along an axis, and a rung that
/// takes it to stand `taken_mm` from where it nominally does.
struct Shifted {
  Shifted(const std::string& name, int axis, double shift_mm, const SensorModel& right = plain_model(),
          double taken_mm = 0)
      : target(capture_of(name)), model(right) {
    std::vector<Offset> offsets(campaign().forward().captures().size());
    offsets[target].pose[3 + axis] = shift_mm;
    const auto recording = bench::simulated_recording(campaign().forward(), model, offsets, 5);
    std::vector<std::string> unreadable;
    measured = experiment.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
    offsets[target].pose[3 + axis] = taken_mm;
    rung = fit_rung(experiment, motions, measured, model, offsets, options);
  }
  double score() const { return proper_score(experiment.layout(), rung, Part::all); }

  const int target;
  const SensorModel model;
  const RungOptions options{.simulations = 24, .passes = 0};
  SimulationCache cache{""};
  const Experiment experiment{campaign().forward(), model, cache};
  const std::vector<SceneMotion> motions =
      scene_motions(experiment, model, registration_prior(campaign().forward().set(), experiment.nominal(0).camera));
  Measurement measured;
  Rung rung;
};

TEST(RegisterByEdges, FindsABinThatStandsToTheSide) {
  constexpr double shift_mm = 0.45;  // three times what is stated, a quarter of a pixel
  Shifted bin("bin", 0, shift_mm);
  const double before = bin.score();
  ASSERT_TRUE(register_by_edges(bin.experiment, bin.motions, bin.measured, bin.options, bin.rung));
  EXPECT_LT(bin.score(), before);
  const Offset& found = bin.rung.offsets[bin.target];
  EXPECT_NEAR(found.pose[3], shift_mm, shift_mm / 2);
  EXPECT_NEAR(found.pose[4], 0, shift_mm / 2);
}

TEST(RegisterByEdges, FindsAPlaneThatWasTakenToStandBetweenTwoCoarseSteps) {
  // It stands at 720 mm, where one step ends and the next begins; between them nothing changes with its place.
  constexpr double step_mm = 720 / 180.5, astray_mm = -1.9;
  SensorModel steps = plain_model();
  add_effect(steps, effect_catalogue(), "depth_units", {{"step", step_mm}});
  Shifted plane("plane_720", 2, 0, steps, astray_mm);
  const double before = plane.score();
  ASSERT_TRUE(register_by_edges(plane.experiment, plane.motions, plane.measured, plane.options, plane.rung));
  EXPECT_LT(plane.score(), before);
  EXPECT_NEAR(plane.rung.offsets[plane.target].pose[5], 0, 0.1);  // a third of the noise
}

TEST(RegisterByEdges, LeavesTargetsThatStandWhereTheyShould) {
  Shifted nowhere("bin", 0, 0);
  EXPECT_FALSE(register_by_edges(nowhere.experiment, nowhere.motions, nowhere.measured, nowhere.options, nowhere.rung));
  for (const Offset& offset : nowhere.rung.offsets) EXPECT_TRUE(offset == Offset{});
}

}  // namespace
}  // namespace binrig
