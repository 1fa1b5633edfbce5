#include "diagnose/how_often.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "core/random.h"

namespace binrig {
namespace {

/// What a measure that is not quite proportional finds in a recording of 48 frames, each of which may be hit.
double found_in_one(double probability, std::uint64_t key) {
  const RandomStream dice(key);
  int hits = 0;
  for (int frame = 0; frame < 48; ++frame) hits += dice.uniform(static_cast<std::uint64_t>(frame)) < probability;
  return 130 * hits - 0.6 * hits * hits + 40 * dice.normal(1000);
}

std::vector<double> found_in_many(double probability, std::uint64_t key) {
  std::vector<double> found;
  for (std::uint64_t k = 0; k < 24; ++k) found.push_back(found_in_one(probability, mix_keys(key, k)));
  return found;
}

TEST(HowOften, IsTrueOnAverageAndItsIntervalsHold) {
  constexpr int recordings = 400;
  for (const double truth : {0.1, 0.2, 0.4}) {
    double sum = 0;
    int held = 0;
    for (int k = 0; k < recordings; ++k) {
      const std::uint64_t key = mix_keys(static_cast<std::uint64_t>(1000 * truth), static_cast<std::uint64_t>(k));
      const HowOften often = how_often([&](double value) { return found_in_many(value, mix_keys(key, 7)); },
                                       found_in_one(truth, key), 0.15, 0, 1);
      const auto [low, high] = often.interval(2.07);  // Student, 23 degrees of freedom
      sum += often.value;
      held += low <= truth && truth <= high;
    }
    // One recording: sqrt(p q / 48). The mean of 24 has as large an error as 24th parts of it, and is squared.
    const double deviation = std::sqrt(truth * (1 - truth) / 48);
    EXPECT_NEAR(sum / recordings, truth, 4 * deviation / std::sqrt(recordings) + 0.04 * truth) << truth;
    // 95 %, less 4 of its own deviations (1.1 %): of 0.4, where few are spared, intervals for rare events are too wide.
    EXPECT_GT(held, 0.905 * recordings) << truth;
  }
}

TEST(HowOften, SaysNothingWhereNothingIsFound) {
  const auto nothing = [](double) { return std::vector<double>(24, 0.0); };
  const HowOften unknown = how_often(nothing, 3, 0.2, 0, 1);
  EXPECT_EQ(unknown.scatter, 0);
  EXPECT_EQ(unknown.value, 0.2);
}

TEST(HowOften, WhatIsNeverFoundMayStillHappenNowAndThen) {
  const HowOften never = how_often([](double value) { return found_in_many(value, 5); }, -20, 0.2, 0, 1);
  EXPECT_EQ(never.value, 0);
  const auto [low, high] = never.interval(2.07);
  EXPECT_EQ(low, 0);
  // None in 48 frames: with 2.5 %, 0.074.
  EXPECT_NEAR(high, 1 - std::pow(0.025, 1.0 / 48), 0.04);
}

TEST(HowOften, IntervalsAreWhereTheValueIsJustWithinReach) {
  const HowOften often{0.05, 0.018};
  const auto [low, high] = often.interval(2);
  for (const double end : {low, high}) EXPECT_NEAR(std::abs(end - often.value), 2 * std::sqrt(0.018 * end), 1e-12);
  EXPECT_LT(often.value - low, high - often.value);
}

}  // namespace
}  // namespace binrig
