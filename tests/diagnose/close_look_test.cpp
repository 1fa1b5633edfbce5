// Among periods that signatures do not know, the right one.
#include "diagnose/close_look.h"

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// Looks for an effect where it comes nearest what the fitted model leaves, from its first atom.
class CloseLook {
 public:
  CloseLook(const Case& c, const std::string& effect)
      : rung_(c.fitted({.simulations = 8, .passes = 1})),
        all_(make_hypotheses(c.experiment.forward(), c.start)),
        h_(static_cast<int>(std::ranges::find(all_.tested, effect, &Hypothesis::effect) - all_.tested.begin())),
        book_(c.experiment, c.start, all_, {}),
        refiner_{c.experiment, c.motions, rung_, c.measured, 2, 501, Part::all, frames_for(rung_)} {
    if (h_ == static_cast<int>(all_.tested.size())) throw Error("no hypothesis " + effect);
    book_.look_at({h_}, false);
  }

  LinearGain nearest(double least = 0) const {
    const Hypothesis& its = all_.tested.at(h_);
    const LinearGain start{h_, 0, its.paths[0].atoms[0].values};
    const LinearGain found = look_close_by(refiner_, its, start, book_.signatures(), {}, least);
    EXPECT_EQ(found.hypothesis, h_);
    return found;
  }

 private:
  const Rung rung_;
  const Hypotheses all_;
  const int h_;
  SignatureBook book_;
  const Refiner refiner_;
};

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
    const LinearGain found = CloseLook(c, "column_banding").nearest();
    // Neighbours differ by one period across the image.
    EXPECT_NEAR(width / found.values.at("period"), width / period, 1) << period;
  }
}

TEST(LookCloseBy, AWaveIsNotTakenForOneThatDoesTheSameToAFewTargets) {
  // What moves most when waves are added are long series and what stands near. Behind smoothed edges, a wave that is
  // 2 % longer and elsewhere in its period does the same to three of them.
  const bench::SmallCampaign world;
  const double wavelength_mm = 126;
  SensorModel truth = model_with("tof_wiggling", {{"amplitude", 0.35}, {"wavelength", wavelength_mm}, {"phase", 0.3}});
  const SensorModel start = without_effect(truth, "tof_wiggling");
  add_effect(truth, effect_catalogue(), "smoothing", {{"sigma", 1.0}});
  const Case c(truth, start, world);
  const CloseLook look(c, "tof_wiggling");
  const LinearGain found = look.nearest();
  // Half of the way to the next one that is tried.
  const double apart = 0.25 * period_spacing(*effect_catalogue().find("tof_wiggling")->parameter("wavelength"),
                                             wavelength_mm, c.experiment.nominal(0).depth_mm.cols);
  EXPECT_NEAR(found.values.at("wavelength") / wavelength_mm, 1, 0.5 * apart);
  // What has to gain more than all captures could is not looked for any further, and nothing else is.
  EXPECT_EQ(look.nearest(found.gain).values, found.values);
  EXPECT_EQ(look.nearest(100 * found.gain).gain, 0);
}

}  // namespace
}  // namespace binrig
