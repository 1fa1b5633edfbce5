// Steps read off recorded values, and what they are worth to a search.
#include "diagnose/step_reader.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "diagnose/anew.h"
#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

SensorModel with_step(const char* effect, double step) {
  SensorModel model = noise_alone(0.15);
  add_effect(model, effect_catalogue(), effect, {{"step", step}});
  return model;
}

/// What is seen in a recording of the truth by who knows the model.
SeenSteps seen_in(const Case& c, const SensorModel& model) {
  const Experiment::FrameReader frames = [&](int capture, int i) { return c.recording[capture][i]; };
  StepReader steps(c.experiment, frames);
  std::vector<std::string> unreadable;
  c.experiment.measure(steps.reader(), unreadable);
  return steps.seen(model);
}

bool has(const std::vector<ReadStep>& steps, double step) {
  return std::ranges::any_of(
      steps, [&](const ReadStep& read) { return std::abs(read.value - step) < 0.2 * read.uncertainty; });
}

TEST(StepReader, SeesStepsThatTheModelLacks) {
  const SensorModel model = noise_alone(0.3);
  EXPECT_TRUE(has(seen_in(Case(with_step("depth_units", 0.541), model), model).depth_mm, 0.541));
  EXPECT_TRUE(has(seen_in(Case(with_step("disparity_quantisation", 0.0708), model), model).disparity_px, 0.0708));
}

TEST(StepReader, SeesNoneThatTheModelHas) {
  const SensorModel stepped = with_step("depth_units", 0.541);
  EXPECT_FALSE(has(seen_in(Case(stepped, stepped), stepped).depth_mm, 0.541));
}

/// What a second look makes of the steps seen.
std::vector<Anew> steps_looked_at(const Case& c, const SensorModel& given, std::vector<std::string>& effects) {
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), given, seen_in(c, given));
  std::erase_if(hypotheses.tested, [](const Hypothesis& h) { return !is_step(*h.declaration); });
  for (const Hypothesis& h : hypotheses.tested) effects.push_back(h.effect);
  SignatureBook book(c.experiment, given, hypotheses, {});
  book.look_at({0, 1}, false);
  return look_anew(c.experiment, c.motions, c.measured, {given, book.signatures(), book.simulations()}, hypotheses, -1,
                   1, 11);
}

// Between those that are tried anyway (0.026, 0.088 and 0.297 px), on noise other than the model's.
TEST(StepReader, ASecondLookBeginsAtTheStepSeen) {
  const SensorModel given = noise_alone(0.3);
  const Case c(with_step("disparity_quantisation", 0.0708), given);
  std::vector<std::string> effects;
  const auto found = steps_looked_at(c, given, effects);
  ASSERT_EQ(found.size(), 1);
  ASSERT_EQ(effects.at(found[0].hypothesis), "disparity_quantisation");
  EXPECT_NEAR(found[0].fit.model.find(found[0].id)->value("step"), 0.0708, 0.0708 * 1e-4);
}

TEST(StepReader, ASecondLookTakesNoStepWhereNothingIsRounded) {
  const SensorModel given = noise_alone(0.3);
  std::vector<std::string> effects;
  EXPECT_TRUE(steps_looked_at(Case(noise_alone(0.15), given), given, effects).empty());
  EXPECT_EQ(effects.size(), 2);
}

}  // namespace
}  // namespace binrig
