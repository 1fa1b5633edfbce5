// Intervals of what a diagnosis added, beyond what slopes say.
#include "diagnose/intervals.h"

#include <algorithm>
#include <tuple>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

// Pixels lie 0.5 px and the root of a whole number from an edge: from 2.5 up to 2.73 px a width takes in the same ones.
// A slope over more than that says nothing of it.
TEST(WidenedIntervals, HoldAllWidthsThatTakeInTheSamePixels) {
  const SensorModel truth = model_with("flying_pixels", {{"probability", 0.3}, {"width", 2.7}});
  const Case c(truth, truth);
  const Rung rung = c.fitted({.simulations = 16, .passes = 1});
  const LastStep step = last_step(c.experiment, c.motions, rung, rung.fit.parameters, false, 5);
  SensorModel model = step.model;
  const auto intervals =
      widened_intervals({c.experiment, c.motions, rung, step, rung.fit.parameters}, {"flying_pixels"}, model);
  ASSERT_EQ(intervals.size(), 2);  // nothing of the noise
  for (const auto& [name, least, most] : {std::tuple{"width", 2.5, 2.73}, std::tuple{"probability", 0.3, 0.3}}) {
    const auto found = std::ranges::find(intervals, name, &CalibratedParameter::name);
    ASSERT_TRUE(found != intervals.end() && found->determined()) << name;
    EXPECT_LE((*found->ci95)[0], least) << name;
    EXPECT_GE((*found->ci95)[1], most) << name;
    EXPECT_DOUBLE_EQ(model.find("flying_pixels")->value(name), found->value);
  }
}

// A window of 7 px with a slightly narrower weight smooths as one of 5 px does: both hold, whatever the other was fitted
// with.
TEST(WidenedIntervals, HoldAWholeNumberThatAnotherParameterMakesUpFor) {
  const auto blur = [](double diameter) {
    return model_with("bilateral_blur", {{"sigma_px", 0.8}, {"sigma_z", 5}, {"diameter", diameter}});
  };
  const Case c(blur(5), blur(6));
  const Rung rung = c.fitted({.simulations = 16, .passes = 1});
  const LastStep step = last_step(c.experiment, c.motions, rung, rung.fit.parameters, false, 5);
  SensorModel model = step.model;
  const auto intervals =
      widened_intervals({c.experiment, c.motions, rung, step, rung.fit.parameters}, {"bilateral_blur"}, model);
  const auto found = std::ranges::find(intervals, "diameter", &CalibratedParameter::name);
  ASSERT_TRUE(found != intervals.end() && found->determined());
  EXPECT_LE((*found->ci95)[0], 5);
  EXPECT_GT((*found->ci95)[0], 3);  // 3 px and less do not reach the neighbours' neighbours
  EXPECT_GE((*found->ci95)[1], 7);
  EXPECT_DOUBLE_EQ(model.find("bilateral_blur")->value("diameter"), found->value);
}

}  // namespace
}  // namespace binrig
