// Where a hypothesis has a period: the right one among those that maps of cells take for each other.
#include "diagnose/refine.h"

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

TEST(LookCloseBy, APeriodIsNotTakenForItsAliasInMapsOfCells) {
  // In cells of 4 px a wave of 5.03 px is one of 19.5 px, with a quarter of its amplitude.
  constexpr int width = 320, frames = 3;
  bench::Campaign planes(7);
  for (const char* split : {"train", "test"}) planes.plane(split, "plane", frames, 700);
  const bench::SmallCampaign large(planes, width);
  for (const double period : {19.635, 14.0, 24.0, 12.0, 30.0, 5.03}) {
    const double amplitude = period > 10 ? 0.17 : 0.45;
    const SensorModel truth =
        model_with("column_banding", {{"amplitude", amplitude}, {"period", period}, {"phase", -1.44}});
    const Case c(truth, without_effect(truth, "column_banding"), large);
    ASSERT_EQ(c.experiment.context(0).bin_px(), 4);
    const Rung rung = c.fitted({.simulations = 8, .passes = 1});
    const Hypotheses all = make_hypotheses(large.forward(), c.start);
    const auto banding = std::ranges::find(all.tested, "column_banding", &Hypothesis::effect);
    ASSERT_NE(banding, all.tested.end());
    const int h = static_cast<int>(banding - all.tested.begin());
    SignatureBook book(c.experiment, c.start, all, {});
    book.look_at({h}, false);
    const Refiner refiner{c.experiment, c.motions, rung, c.measured, 2, 501, Part::all, frames_for(rung)};
    const LinearGain found =
        look_close_by(refiner, *banding, {h, 0, banding->paths[0].atoms[0].values}, book.signatures());
    // Neighbours differ by one period across the image.
    EXPECT_NEAR(width / found.values.at("period"), width / period, 1) << period;
    EXPECT_EQ(found.hypothesis, h);
  }
}

}  // namespace
}  // namespace binrig
