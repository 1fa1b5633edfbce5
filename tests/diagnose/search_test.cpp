// Searches on recordings whose truth is known: what is looked for, where, and how it is judged.
#include "diagnose/search.h"

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

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
