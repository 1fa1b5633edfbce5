// The last step of a fit: where it leads, and how far it trusts itself.
#include "diagnose/last_step.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// The last step of a model that was not fitted, on a recording with a radial distortion of 0.25 px.
struct Taken {
  explicit Taken(double amplitude)
      : c(model_with("radial_distortion", {{"amplitude", 0.25}}),
          model_with("radial_distortion", {{"amplitude", amplitude}})),
        rung(c.fitted({.simulations = 16, .passes = 0})),
        step(last_step(c.experiment, c.motions, rung, rung.fit.parameters, false, 5)) {
    for (std::size_t p = 0; p < rung.fit.parameters.size(); ++p)
      if (rung.fit.parameters[p].id == "radial_distortion") index = static_cast<int>(p);
  }
  double deviation() const { return std::sqrt(step.covariance(index, index)); }
  double amplitude(double share) const {
    return stepped(step, rung.fit.parameters, share).find("radial_distortion")->value("amplitude");
  }

  const Case c;
  const Rung rung;
  const LastStep step;
  int index = -1;
};

TEST(LastStep, OfTheRightModelIsShort) {
  const Taken taken(0.25);
  ASSERT_GE(taken.index, 0);
  const double n = static_cast<double>(taken.rung.fit.parameters.size());
  EXPECT_LT(taken.step.length, std::sqrt(n + 3 * std::sqrt(2 * n)));
  EXPECT_NEAR(taken.amplitude(1), 0.25, 5 * taken.deviation());
  EXPECT_LT(taken.deviation(), 0.05);  // a fifth of it: so much these planes say
}

TEST(LastStep, ThatIsTooLongForChanceIsSpannedByItsOwnDeviation) {
  const Taken taken(0.1);
  ASSERT_GE(taken.index, 0);
  EXPECT_GT(taken.step.length, 10);
  EXPECT_NEAR(taken.amplitude(1), 0.25, 0.1);
  EXPECT_GE(taken.deviation(), std::abs(taken.step.step[taken.index]));
}

TEST(LastStep, LeadsToEveryShareOfItself) {
  const Taken taken(0.1);
  ASSERT_GE(taken.index, 0);
  EXPECT_DOUBLE_EQ(taken.amplitude(0), 0.1);
  EXPECT_DOUBLE_EQ(taken.amplitude(1), taken.step.model.find("radial_distortion")->value("amplitude"));
  EXPECT_NEAR(taken.amplitude(0.5), 0.5 * (taken.amplitude(0) + taken.amplitude(1)), 1e-9);
}

}  // namespace
}  // namespace binrig
