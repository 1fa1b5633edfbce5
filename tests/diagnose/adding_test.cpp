// An effect that moves what the lens moves, and a lens that was left to take its part.
#include "diagnose/adding.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

std::size_t focal_length(const std::vector<SceneMotion>& motions) {
  std::size_t m = 0;
  while (motions[m].capture >= 0 || motions[m].element != 6) ++m;
  return m;
}

// The focal length is stated to 0.25 px of about 110 px: a focal error of 0.02 are nine of these. A fit that stands there
// sees less, since half of what it leaves would be the effect's.
TEST(Adding, TheLensGoesBackToWhereItIsStatedAndTheEffectTakesItsPart) {
  constexpr double truth = 0.02, astray = 0.02;
  const SensorModel given = noise_alone(0.3);
  const Case c(model_with("focal_error", {{"error", truth}}), given);
  const std::size_t focal = focal_length(c.motions);
  RungOptions options;
  options.simulations = 16;
  SensorModel model = given;
  add_effect(model, effect_catalogue(), "focal_error", {{"error", truth}});
  const Rung right = fit_rung(c.experiment, c.motions, c.measured, model, {}, options);
  // Of the two signs that the lens may have, the one with which it makes up for the error.
  std::optional<Rung> swapped;
  for (const double sign : {-1, 1}) {
    value_in(model, "focal_error", "error").value = truth + astray;
    std::vector<Offset> offsets = right.offsets;
    for (Offset& offset : offsets) offset.focal_px = sign * astray * c.experiment.nominal(0).camera.fx;
    Rung rung = made_anew(c.experiment, c.motions, c.measured, model, offsets, options, right.fit.parameters);
    if (!swapped || rung.dispersion < swapped->dispersion) swapped = std::move(rung);
  }
  ASSERT_LT(swapped->dispersion, leaves_something);
  ASSERT_GT(std::abs(swapped->nuisances[focal]), 4);
  const Adding adding(c.experiment, c.motions, c.measured, given, 3);
  const auto back = adding.lens_put_back(*swapped, "focal_error", options);
  ASSERT_TRUE(back);
  EXPECT_LT(std::abs(back->nuisances[focal]), 2);
  EXPECT_NEAR(back->model.find("focal_error")->value("error"), truth, 3 * 0.25 / 110);
  EXPECT_FALSE(adding.lens_put_back(*swapped, "spectral_noise", options));
}

// What is missing besides pulls a step that is fitted or tried to where it does not belong.
TEST(Adding, AStepThatWasSeenStaysWhereItWasRead) {
  constexpr double seen = 0.52;
  const SensorModel given = noise_alone(0.3);
  SensorModel truth = given;
  add_effect(truth, effect_catalogue(), "depth_units", {{"step", 0.55}});
  const Case c(truth, given);
  RungOptions options;
  options.simulations = 8;
  const Rung rung = fit_rung(c.experiment, c.motions, c.measured, given, {}, options);
  Refined step;
  step.effect = "depth_units";
  step.model = with_effect(given, effect_catalogue(), "depth_units", {{"step", seen}});
  step.id = step.model.effects.back().id;
  const Adding adding(c.experiment, c.motions, c.measured, given, 3);
  const auto value = [&] { return adding.to(rung, step, options).model.find(step.id)->values.at("step"); };
  EXPECT_NE(value().value, seen) << "tried, if it was not seen";
  step.step_seen = true;
  value_in(step.model, step.id, "step").ci95 = {{seen - 0.01, seen + 0.01}};
  EXPECT_EQ(value().value, seen);
  ASSERT_TRUE(value().ci95);
  EXPECT_EQ((*value().ci95)[0], seen - 0.01);
}

}  // namespace
}  // namespace binrig
