// When two refined hypotheses pass for one: by what they gain, by how alike they are, and by what signatures say.
#include "diagnose/search_result.h"

#include <gtest/gtest.h>

namespace binrig {
namespace {

/// One capture to fit on, nothing marginalised: squared distances are those of the changes.
struct Pair {
  Rung rung;
  Refined better, other;

  /// What they gain, each moving an element of its own by `reach`.
  Pair(double gain, double other_gain, float reach) {
    Layout layout;
    layout.blocks.push_back({0, 0, 0, 12 * 16, 12, 16, true});
    layout.size = 12 * 16;
    layout.train = {true};
    layout.captures = 1;
    rung.train = Metric(layout, Part::train, {});
    rung.test = Metric(layout, Part::test, {});
    better.effect = "one", other.effect = "other";
    better.train_gain = gain, other.train_gain = other_gain;
    better.change.assign(layout.size, 0.f), other.change.assign(layout.size, 0.f);
    better.change[3] = other.change[40] = reach;
  }
  bool confounded() const { return binrig::confounded(rung, better, other); }
};

TEST(Confounded, WhatLosesClearlyIsNot) {
  const Pair pair(400, 390, 15);  // ten behind: three standard deviations of an effect that is known are nine
  ASSERT_NEAR(separation(pair.rung, pair.better, pair.other).distance2, 2 * 15 * 15, 1e-3);
  EXPECT_FALSE(pair.confounded());
  EXPECT_TRUE(Pair(400, 392, 15).confounded());
}

TEST(Confounded, WhatMovesTheSameIsWithinWhatChanceMakesOfTheirDistance) {
  Pair pair(400, 390, 15);
  pair.other.change = pair.better.change;
  pair.other.change[40] = 6;  // squared distance 36, cosine 15 / sqrt(15^2 + 6^2): chance makes 12 of it
  EXPECT_TRUE(pair.confounded());
  pair.other.train_gain = 387;
  EXPECT_FALSE(pair.confounded());
}

TEST(Confounded, ANarrowWinProvesNothingWhereSignaturesSayTheOpposite) {
  Pair pair(400, 330, 15);
  pair.other.change[3] = 5;
  pair.better.linear_gain = 300, pair.other.linear_gain = 200;
  EXPECT_FALSE(pair.confounded());
  std::swap(pair.better.linear_gain, pair.other.linear_gain);
  EXPECT_TRUE(pair.confounded());
  pair.other.price = 150, pair.other.train_gain = 480;  // the same score, but chance makes half of what signatures gain
  EXPECT_FALSE(pair.confounded());
  pair.other.price = 0;
  pair.other.train_gain = 290;  // lost more than a quarter
  EXPECT_FALSE(pair.confounded());
}

TEST(Confounded, NorWhereSignaturesOfWhatMovesMostlyTheSameCannotTell) {
  Pair pair(400, 330, 15);
  pair.other.change[3] = 16;  // cosine 0.73
  pair.better.linear_gain = 208, pair.other.linear_gain = 200;
  EXPECT_TRUE(pair.confounded());
  pair.better.linear_gain = 210;  // ten behind
  EXPECT_FALSE(pair.confounded());
  pair.better.linear_gain = 208, pair.other.change[3] = 14;  // cosine 0.68
  EXPECT_FALSE(pair.confounded());
  pair.better.linear_gain = 6, pair.other.linear_gain = 5, pair.other.change[3] = 16;  // signatures see neither
  EXPECT_FALSE(pair.confounded());
}

TEST(Confounded, WhatMovesNothingInCommonIsMissingItselfHoweverMuchItGains) {
  Pair pair(400, 330, 15);
  pair.better.linear_gain = 200, pair.other.linear_gain = 300;
  pair.other.change[3] = 1;  // cosine 1 / 15
  EXPECT_FALSE(pair.confounded());
  pair.other.change[3] = 2;
  EXPECT_TRUE(pair.confounded());
}

TEST(Confounded, NorIsWhatMovesNothingInCommonWithAWeakerOne) {
  Pair pair(400, 500, 15);   // as where the stronger one comes first, and this one waits for its turn
  pair.other.change[3] = 1;  // cosine 1 / 15
  EXPECT_FALSE(pair.confounded());
  pair.other.change[3] = 2;
  EXPECT_TRUE(pair.confounded());
}

TEST(Confounded, WhereTheHeldOutCapturesSayNothingThoseFittedToDecide) {
  Pair pair(400, 5, 15);
  pair.better.test_gain = -2000, pair.other.test_gain = 40;  // a target that stands wrong without the better one
  EXPECT_FALSE(pair.confounded());
  pair.other.train_gain = 395;
  EXPECT_TRUE(pair.confounded());
}

SearchResult with_one(const Refined& candidate) {
  SearchResult result;
  result.refined.push_back(candidate);
  return result;
}

TEST(SearchResult, WhatHappensOrNotIsTriedWhereItsSignaturesAreBeyondDoubt) {
  const SearchOptions options;
  Refined repeats;  // in other frames of its simulations than of the recording
  repeats.gate = 16;
  repeats.linear_gain = 500;
  repeats.train_gain = -200;
  repeats.share = -0.1;
  repeats.test_gain = 900;
  repeats.shown_on_test = 300;
  repeats.happens_or_not = true;
  EXPECT_TRUE(with_one(repeats).accepted(options).empty());
  EXPECT_EQ(with_one(repeats).unproven(options).size(), 1u);

  Refined steady = repeats, doubtful = repeats, unseen = repeats;
  steady.happens_or_not = false;
  doubtful.linear_gain = 1.5 * doubtful.gate;
  unseen.shown_on_test = 0;
  for (const Refined& other : {steady, doubtful, unseen}) EXPECT_TRUE(with_one(other).unproven(options).empty());

  // Beside it another's fit means nothing, unless that one's signatures gain more.
  Refined fitted;
  fitted.linear_gain = 5;
  fitted.train_gain = fitted.test_gain = 400;
  SearchResult both = with_one(repeats);
  both.refined.push_back(fitted);
  EXPECT_EQ(both.happening(options), &both.refined[0]);
  both.refined[1].linear_gain = 501;
  EXPECT_EQ(both.happening(options), nullptr);
  both.refined[1].draws = true;  // a map in each capture, which fewer frames in its mean look like
  EXPECT_EQ(both.happening(options), &both.refined[0]);
  for (const Refined& other : {steady, doubtful, unseen}) EXPECT_EQ(with_one(other).happening(options), nullptr);
}

TEST(SearchResult, WhatExplainsTrainButNothingHeldOutIsTriedOnlyWhereItShowsThere) {
  const SearchOptions options;
  Refined bent;
  bent.gate = 16;
  bent.train_gain = 100;
  bent.test_gain = 0;
  bent.shown_on_test = 50;
  EXPECT_TRUE(with_one(bent).accepted(options).empty());
  EXPECT_EQ(with_one(bent).unproven(options).size(), 1u);
  EXPECT_TRUE(with_one(bent).unconfirmed(options).empty());
  bent.shown_on_test = 0;
  EXPECT_TRUE(with_one(bent).unproven(options).empty());
  EXPECT_EQ(with_one(bent).unconfirmed(options).size(), 1u);
  bent.test_gain = 10;
  EXPECT_EQ(with_one(bent).accepted(options).size(), 1u);
}

TEST(SearchResult, WhatTheCapturesHeldOutShowBeyondDoubtNeedsLessOfTrain) {
  const SearchOptions options;
  Refined stands_in_bent;  // a model bent to the train captures leaves little there
  stands_in_bent.gate = 80;
  stands_in_bent.train_gain = 70;
  stands_in_bent.test_gain = 490;
  EXPECT_EQ(with_one(stands_in_bent).accepted(options).size(), 1u);
  stands_in_bent.test_gain = 100;
  EXPECT_TRUE(with_one(stands_in_bent).accepted(options).empty());
  stands_in_bent.test_gain = 490;
  stands_in_bent.train_gain = 10;
  EXPECT_TRUE(with_one(stands_in_bent).accepted(options).empty());
}

/// One capture to fit on and one to hold out, ten statistics each, no nuisances.
struct TwoCaptures {
  Layout layout;
  Rung rung;
  TwoCaptures() {
    for (int c = 0; c < 2; ++c) {
      layout.blocks.push_back({c, 5, layout.size, 10, 1, 10, c == 0});
      layout.size += 10;
      layout.train.push_back(c == 0);
    }
    layout.captures = 2;
    rung.train = Metric(layout, Part::train, {});
    rung.test = Metric(layout, Part::test, {});
  }
  /// Moves one statistic of either capture by 10, and another by `more`.
  Refined moving(const std::string& effect, int statistic, double gain, int other = 0, float more = 0) const {
    Refined refined;
    refined.effect = effect;
    refined.train_gain = gain;
    refined.change.assign(layout.size, 0.f);
    for (const int c : {0, 10}) {
      refined.change[c + other] += more;
      refined.change[c + statistic] += 10;
    }
    return refined;
  }
};

// A focal length and a depth that are off leave no statistic out of place: as long as this says so, those behind one
// that makes the model no better have their turn.
TEST(Misplaced, WherePosesOrTheLensAreFarFromWhereTheyAreStated) {
  Rung rung;
  rung.dispersion = 1;
  rung.train_stated = {.poses = 1, .intrinsics = 2.9};
  EXPECT_FALSE(misplaced(rung, {}));
  rung.train_stated.intrinsics = 140;
  EXPECT_TRUE(misplaced(rung, {}));
  rung.train_stated = {.poses = 10, .intrinsics = 1};
  EXPECT_TRUE(misplaced(rung, {}));
}

TEST(StandingBeside, ThoseThatMoveOtherThingsAndGainMuchInTheirOrder) {
  const TwoCaptures two;
  const Refined best = two.moving("best", 1, 1000), apart = two.moving("apart", 2, 900),
                alike = two.moving("alike", 3, 800, 1, 3.f),  // cosine 0.29 to the best
      like_apart = two.moving("second", 4, 700, 2, 3.f),      // and to the one apart
      hardly = two.moving("hardly", 5, 600, 1, 0.5f),         // 0.05
      weak = two.moving("weak", 6, 240);
  const auto beside = standing_beside(two.rung, best, {&best, &apart, &alike, &like_apart, &hardly, &weak});
  EXPECT_EQ(beside, (std::vector<const Refined*>{&apart, &hardly}));
  const Refined elsewhere = two.moving("apart", 7, 500);  // the same effect by other parameters
  EXPECT_EQ(standing_beside(two.rung, best, {&apart, &elsewhere}).size(), 1u);
  EXPECT_TRUE(standing_beside(two.rung, best, {&best}).empty());
}

TEST(StandingBeside, WhatDrawsMapsHasPowerInCommonWithAllThatDo) {
  const TwoCaptures two;
  Refined best = two.moving("best", 1, 1000), other = two.moving("other", 2, 900), third = two.moving("third", 3, 800);
  best.draws = other.draws = true;
  EXPECT_EQ(standing_beside(two.rung, best, {&best, &other, &third}), (std::vector<const Refined*>{&third}));
}

TEST(SearchResult, WhatExplainsFarMoreOnTrainIsTriedBeforeWhatProvedItself) {
  const SearchOptions options;
  Refined proven;
  proven.gate = 16;
  proven.train_gain = 100;
  proven.test_gain = 50;
  Refined shaking = proven;  // makes noise maps of the captures held out larger or smaller as wholes
  shaking.train_gain = 1.01 * options.far_ahead_on_train * proven.train_gain;
  shaking.test_gain = -500;
  shaking.shown_on_test = 400;
  SearchResult found;
  found.refined = {proven, shaking};
  EXPECT_EQ(found.worthy(options), (std::vector<const Refined*>{&found.refined[1], &found.refined[0]}));

  found.refined[1].train_gain = 0.99 * options.far_ahead_on_train * proven.train_gain;
  EXPECT_EQ(found.worthy(options), std::vector<const Refined*>{&found.refined[0]}) << "not far enough ahead";
  found.refined[0].test_gain = 0;
  EXPECT_EQ(found.worthy(options), std::vector<const Refined*>{&found.refined[1]}) << "nothing proved itself";
}

TEST(ComesClose, WhatTheBestOneCouldNotProveHeldOutCountsForNeither) {
  const SearchOptions options;
  Refined best, other;
  best.train_gain = 2100, best.test_gain = -300;
  other.train_gain = 2100, other.test_gain = -600;
  EXPECT_TRUE(comes_close(best, other, options));
  other.train_gain = 0.99 * options.close_behind * best.train_gain;
  EXPECT_FALSE(comes_close(best, other, options));
  other.from_given = true;
  EXPECT_TRUE(comes_close(best, other, options)) << "it leans on no bent parameter";

  best.test_gain = 300, other = {};
  other.train_gain = 2100, other.test_gain = -600;
  EXPECT_FALSE(comes_close(best, other, options)) << "it lost what the best one proved";
}

TEST(IsRival, GainsAShareOfTheBestThoughItComesNotClose) {
  const SearchOptions options;
  ASSERT_LT(options.rival, options.close_behind);
  Refined best, other;
  best.train_gain = 1600, best.test_gain = 900;
  other.train_gain = 0.5 * (options.rival + options.close_behind) * 1600, other.test_gain = 0.8 * 900;
  EXPECT_TRUE(is_rival(best, other, options));
  EXPECT_FALSE(comes_close(best, other, options));
  other.test_gain = 0.3 * 900;
  EXPECT_FALSE(is_rival(best, other, options)) << "held out it is far behind";
}

TEST(SearchResult, OneExplainsItAllWhereTheOthersExplainNextToNothing) {
  const SearchOptions options;
  Refined most, other;
  most.effect = "most";
  most.share = 0.9;
  most.train_gain = 1000;
  most.test_gain = 300;
  other.effect = "other";
  other.train_gain = 200;
  SearchResult found;
  EXPECT_FALSE(found.explained_by_one(options)) << "nothing was found";
  found.refined = {other, most};
  EXPECT_TRUE(found.explained_by_one(options));
  found.refined[0].train_gain = 400;
  EXPECT_FALSE(found.explained_by_one(options)) << "another explains much of it, too";
  found.refined[0].effect = "most";
  EXPECT_TRUE(found.explained_by_one(options)) << "it is the same effect, fitted twice";
  found.refined[1].share = 0.5;
  EXPECT_FALSE(found.explained_by_one(options)) << "half is left";
  found.refined[1].share = 0.9;
  found.refined[1].gate = 2000;
  EXPECT_FALSE(found.explained_by_one(options)) << "chance explains as much";
  found.refined[1].gate = 0;
  found.refined[1].test_gain = -170;
  EXPECT_FALSE(found.explained_by_one(options)) << "the captures held out say otherwise";
}

TEST(SearchResult, WhatIsCertainNeedsNoGain) {
  const SearchOptions options;
  Refined step;
  step.train_gain = step.test_gain = -1000;
  SearchResult found;
  found.refined = {step};
  EXPECT_TRUE(found.worthy(options).empty());
  found.refined[0].certain = true;
  EXPECT_EQ(found.worthy(options), std::vector<const Refined*>{&found.refined[0]});
}

}  // namespace
}  // namespace binrig
