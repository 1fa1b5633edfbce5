// The last steps of a fit, and the targets that stood where an earlier one wanted them.
#include "diagnose/settle.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

// Two targets move along z by 30 and 25 mm/s, known to 0.15 mm: without the delay they seem to stand 15 and 13 of these
// before and behind where they are. Known so well they know the delay to 0.15 mm / 30 mm/s.
TEST(SettleDown, WhatAStepMovesComesBackWithIt) {
  constexpr double truth = 0.0775, far_from = 0.003, known_to = 0.15 / 30;
  static const bench::SmallCampaign with_motion;
  SensorModel delayed = noise_alone(0.3);
  add_effect(delayed, effect_catalogue(), "latency", {{"delay", truth}});
  const Case c(delayed, noise_alone(0.3), with_motion);
  const RungOptions options{.simulations = 8};
  const auto furthest = [&](const Rung& rung) {
    double sigmas = 0;
    for (std::size_t m = 0; m < c.motions.size(); ++m)
      if (c.motions[m].capture >= 0) sigmas = std::max(sigmas, std::abs(rung.nuisances[m]));
    return sigmas;
  };
  const Rung without = c.fitted(options);
  ASSERT_GT(furthest(without), 10);
  SensorModel model = without.model;
  add_effect(model, effect_catalogue(), "latency", {{"delay", far_from}});
  Rung rung = made_anew(c.experiment, c.motions, c.measured, model, without.offsets, options,
                        fit_parameters(model, effect_catalogue()));
  settle_down(c.experiment, c.motions, c.measured, options, rung);
  EXPECT_NEAR(rung.model.find("latency")->value("delay"), truth, 3 * known_to);
  EXPECT_LT(furthest(rung), 4) << "of some hundred";
}

}  // namespace
}  // namespace binrig
