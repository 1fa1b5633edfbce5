// A hypothesis on top of a rung: the right one of its periods, and what it draws anew in each recording.
#include "diagnose/refine.h"

#include <gtest/gtest.h>

#include "diagnose/search.h"
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

TEST(Remainder, KnowsHowFarAModelsOwnRecordingsScatter) {
  // Patches wider than a cell of the bias maps put a map of chance into each capture of a tilted target.
  const Case c(noise_alone(0.3), noise_alone(0.3));
  const Rung rung = c.fitted({.simulations = 12, .passes = 1});
  Refiner refiner{c.experiment, c.motions, rung, c.measured};
  refiner.seeds = 4;
  const auto remainder = [&](double hold) {
    SensorModel model = rung.model;
    add_effect(model, effect_catalogue(), "fronto_parallel_patches", {{"hold", hold}, {"slant", 0.2}, {"pitch", 8}});
    return remainder_of(refiner, model, rung.offsets, rung.place);
  };
  const Remainder none = remainder(0), some = remainder(0.3), more = remainder(0.6);
  // The recording is one of the model's: it is as far from their mean as they are. Compressed, a normal value's square
  // is a little less than 1, and the practical floors take their part of both.
  EXPECT_NEAR(none.scatter, none.train, 0.1 * none.train);
  EXPECT_GT(some.scatter, 1.5 * none.scatter);
  EXPECT_GT(more.scatter, some.scatter);
}

TEST(Search, WhatARecordingsOwnDrawLeavesIsNotHeldAgainstAHypothesis) {
  // Most of what is left is the draw, and no other one explains it: of that the right effect explains next to nothing.
  const SensorModel start = noise_alone(0.3);
  const Case c(model_with("fronto_parallel_patches", {{"hold", 0.5}, {"slant", 0.2}, {"pitch", 8}}), start);
  const Rung rung = c.fitted({.simulations = 12, .passes = 1});
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), start);
  std::erase_if(hypotheses.tested, [](const Hypothesis& h) { return h.effect != "fronto_parallel_patches"; });
  ASSERT_EQ(hypotheses.tested.size(), 1);
  SignatureBook book(c.experiment, start, hypotheses, {});
  book.look_at({0}, false);
  const SearchOptions options;
  const SearchResult found = search(
      c.experiment, c.motions, rung, c.measured, hypotheses, book.signatures(), {},
      [&] {
        return Beginning{start, book.signatures(), book.simulations()};
      },
      options);
  ASSERT_FALSE(found.refined.empty());
  EXPECT_FALSE(found.accepted(options).empty());
}

TEST(Search, LooksCloselyForAPeriodThatSignaturesHardlySee) {
  // Another one explains much more than the wave does at the few periods that are simulated; at its own, that does.
  const SensorModel start = noise_alone(0.3);
  SensorModel truth = model_with("row_banding", {{"amplitude", 0.17}, {"period", 8.43}, {"phase", 0.77}});
  add_effect(truth, effect_catalogue(), "low_signal_noise", {{"amplitude", 0.39}});
  const Case c(truth, start);
  const Rung rung = c.fitted({.simulations = 12, .passes = 1});
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), start);
  std::erase_if(hypotheses.tested,
                [](const Hypothesis& h) { return h.effect != "row_banding" && h.effect != "low_signal_noise"; });
  SignatureBook book(c.experiment, start, hypotheses, {});
  book.look_at({0, 1}, false);
  const auto looks = [&](const Standing& standing) {
    return search(
        c.experiment, c.motions, rung, c.measured, hypotheses, book.signatures(), standing,
        [&] {
          return Beginning{start, book.signatures(), book.simulations()};
        },
        SearchOptions{});
  };
  const SearchResult found = looks({});
  const auto wave = std::ranges::find(found.refined, "row_banding", &Refined::effect);
  const auto other = std::ranges::find(found.refined, "low_signal_noise", &Refined::effect);
  ASSERT_TRUE(wave != found.refined.end() && other != found.refined.end());
  EXPECT_LT(wave->linear_gain, 0.15 * other->linear_gain) << "no reason to look closely";
  EXPECT_GT(wave->train_gain, other->train_gain);
  EXPECT_NEAR(wave->model.find(wave->id)->value("period"), 8.43, 0.05);
  // Where it was looked for in vain beside as much, it is not looked for again.
  const SearchResult again = looks({.added = false, .closely = false});
  EXPECT_EQ(std::ranges::find(again.refined, "row_banding", &Refined::effect), again.refined.end());
}

TEST(Search, LooksFromTheGivenParametersWhereBentOnesLeaveHardlyAnything) {
  // Little is left, and something explains that; but where a parameter went far since, it may have made up for more.
  const SensorModel start = noise_alone(0.3);
  const Case c(model_with("incidence_noise", {{"amplitude", 0.5}}), start);
  const Rung rung = c.fitted({.simulations = 12, .passes = 1});
  ASSERT_LE(rung.dispersion, leaves_something);
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), start);
  std::erase_if(hypotheses.tested, [](const Hypothesis& h) { return h.effect != "incidence_noise"; });
  SignatureBook book(c.experiment, start, hypotheses, {});
  book.look_at({0}, false);
  const SearchOptions options;
  const auto found = [&](const Standing& standing) {
    return search(
        c.experiment, c.motions, rung, c.measured, hypotheses, book.signatures(), standing,
        [&] {
          return Beginning{start, book.signatures(), book.simulations()};
        },
        options);
  };
  const SearchResult bent = found({.added = true, .bent = true, .looked_in_vain = false, .exact_steps_first = true});
  ASSERT_FALSE(bent.accepted(options).empty());
  EXPECT_TRUE(bent.looked_again);
  EXPECT_FALSE(found({.added = true, .bent = false, .looked_in_vain = false, .exact_steps_first = true}).looked_again);
  EXPECT_FALSE(found({.added = true, .bent = true, .looked_in_vain = true, .exact_steps_first = true}).looked_again);
}

}  // namespace
}  // namespace binrig
