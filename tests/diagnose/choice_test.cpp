#include "diagnose/choice.h"

#include <gtest/gtest.h>

#include "sim/effect.h"

namespace binrig {
namespace {

constexpr double least_gain = 16;

/// Beside it the other's signatures gain `left`, and what is no randomness is `unexplained` in all.
Contender contender(double dispersion, double proper_score, double left, double unexplained, int parameters = 1) {
  return {dispersion, proper_score, [=] { return left; }, [=] { return unexplained; }, parameters};
}

/// One that must not be asked what would cost time.
Contender hurried(double dispersion, double proper_score) {
  return {dispersion, proper_score,
          [] {
            ADD_FAILURE() << "asked what it leaves";
            return 0.0;
          },
          [] {
            ADD_FAILURE() << "asked what is unexplained";
            return 0.0;
          }};
}

TEST(UnexplainedExcess, IsOfWhatIsSignificantOnly) {
  const SegmentFit significant{"spectrum", "", true, 9, 4, 0.1}, by_chance{"noise", "", true, 1.1, 0.1, 0.1};
  EXPECT_EQ(unexplained_excess({significant, by_chance, significant}), 8);
}

TEST(SegmentFit, IsSignificantIfLargeAndBeyondChanceOrSmallAndBeyondItTwice) {
  const auto fit = [](double excess, double spreads, bool on_both_parts = false) {
    return SegmentFit{"bias", "", true, 1, excess, excess / spreads, on_both_parts};
  };
  EXPECT_TRUE(fit(1.1, 7).significant());
  EXPECT_FALSE(fit(1.1, 5).significant()) << "chance";
  EXPECT_FALSE(fit(0.15, 9).significant());
  EXPECT_TRUE(fit(0.15, 11).significant());
  EXPECT_TRUE(fit(0.15, 9, true).significant());
  EXPECT_FALSE(fit(0.05, 50, true).significant()) << "too small to matter";
}

TEST(Choose, WhereSomethingIsLeftTheProperScoreDecides) {
  EXPECT_TRUE(choose(hurried(1.5, -2.0), hurried(1.6, -2.1), least_gain).runner_up);
  EXPECT_FALSE(choose(hurried(1.5, -2.1), hurried(1.4, -2.0), least_gain).runner_up);
  EXPECT_FALSE(choose(hurried(1.5, -2.1), hurried(1.4, -2.0), least_gain).clear) << "a rival all the same";
}

TEST(Choose, WhereNothingIsLeftFewerParametersWithALowerProperScoreOutweighALittleUnexplained) {
  // A strong offset beside a wave of 60 m, which may do the same: chance lifted one segment.
  const Contender wave = contender(1.00, -3.562, 0, 0, 3), offset = contender(1.01, -3.579, 0, 0.24, 1);
  EXPECT_TRUE(choose(wave, offset, least_gain).runner_up);
  EXPECT_FALSE(choose(offset, wave, least_gain).runner_up);
  const Contender as_many = contender(1.01, -3.579, 0, 0.24, 3), hardly_lower = contender(1.01, -3.564, 0, 0.24, 1);
  EXPECT_FALSE(choose(wave, as_many, least_gain).runner_up);
  EXPECT_FALSE(choose(wave, hardly_lower, least_gain).runner_up);
}

TEST(Choose, WhereTheyLeaveNearlyAsMuchUnexplainedTheOneWithFewerParametersComesFirst) {
  // An offset beside a wave that ends at 100 m: poses that are off, by a little more or less.
  const Contender wave = contender(1.00, -3.89, 0.4, 1.25, 3), offset = contender(1.00, -3.89, -0.4, 1.35, 1);
  EXPECT_TRUE(choose(wave, offset, least_gain).runner_up);
  EXPECT_FALSE(choose(offset, wave, least_gain).runner_up);
  const Contender less = contender(1.00, -3.89, 0.4, 1.05, 3);
  EXPECT_FALSE(choose(less, offset, least_gain).runner_up);
}

TEST(Choose, WhereProperScoresAreNextToTheSameLessUnexplainedDecides) {
  // Frames that hardly repeat among the captures held out do not tell dead pixels from random ones; train does.
  EXPECT_FALSE(choose(contender(1.14, -1.1376, 0, 18), contender(1.05, -1.1392, 0, 37), least_gain).runner_up);
  EXPECT_TRUE(choose(contender(1.14, -1.1392, 0, 37), contender(1.15, -1.1376, 0, 18), least_gain).runner_up);
}

TEST(Choose, WhatLeavesSomethingIsNotPreferredToWhatLeavesNothing) {
  EXPECT_FALSE(choose(hurried(1.0, -2.0), hurried(1.2, -2.5), least_gain).runner_up);
}

TEST(Choose, WhatLeavesFarMoreThanTheOneThatLeavesNothingIsNoRival) {
  EXPECT_TRUE(choose(hurried(1.0, -2.0), hurried(1.35, -1.9), least_gain).clear);
  EXPECT_FALSE(choose(hurried(1.04, -2.0), hurried(1.06, -1.9), least_gain).clear);
  const Choice other = choose(hurried(1.35, -1.9), hurried(1.0, -2.0), least_gain);
  EXPECT_TRUE(other.runner_up);
  EXPECT_TRUE(other.clear);
  EXPECT_FALSE(choose(hurried(2.5, -1.9), hurried(1.5, -2.0), least_gain).clear) << "neither explains everything";
}

TEST(Choose, NearTheFloorTheRightOneLeavesNothingForTheOther) {
  const Choice other = choose(contender(1.0, -2.5, 96, 0), contender(1.0, -2.0, -0.2, 5), least_gain);
  EXPECT_TRUE(other.runner_up) << "whatever the scores and the number of statistics";
  EXPECT_TRUE(other.clear);
  const Choice best = choose(contender(1.0, -2.0, -0.2, 5), contender(1.0, -2.5, 96, 0), least_gain);
  EXPECT_FALSE(best.runner_up);
  EXPECT_TRUE(best.clear);
}

TEST(Choose, WhereSignaturesDoNotKnowFewerUnexplainedStatisticsDecide) {
  EXPECT_TRUE(choose(contender(1.0, 0, 3, 2), contender(1.0, 0, 8, 1), least_gain).runner_up);
  EXPECT_FALSE(choose(contender(1.0, 0, 8, 1), contender(1.0, 0, 3, 2), least_gain).runner_up);
  EXPECT_FALSE(choose(contender(1.0, 0, 8, 1), contender(1.0, 0, 3, 2), least_gain).clear);
  EXPECT_TRUE(choose(contender(1.0, 0, 8, 1), contender(1.0, 0, 3, 1), least_gain).runner_up) << "at last a hair";
}

TEST(Choose, WhereNothingTellsThemApartTheOneWithFewerParametersComesFirst) {
  // A wave far longer than the range of distances is an offset.
  const Contender offset = contender(1.0, 0, 1.4, 0), wave = contender(1.0, 0, 1.2, 0, 3);
  EXPECT_TRUE(choose(wave, offset, least_gain).runner_up);
  EXPECT_FALSE(choose(offset, wave, least_gain).runner_up);
  EXPECT_FALSE(choose(offset, wave, least_gain).clear) << "and the other is a rival";
}

TEST(LeavesLess, OnlyIfNothingNewIsUnexplained) {
  const Leftovers before{{"bias", true}, {"noise", true}, {"noise", false}};
  EXPECT_TRUE(leaves_less(before, {{"noise", true}}));
  EXPECT_TRUE(leaves_less(before, {}));
  EXPECT_FALSE(leaves_less(before, before));
  EXPECT_FALSE(leaves_less(before, {{"edges", true}}));
  EXPECT_FALSE(leaves_less(before, {{"bias", false}})) << "train and held-out captures are not the same";
}

TEST(TakesThePlace, WhereItLeavesClearlyLessByOneScoreAndNoMoreByTheOther) {
  const Left present{1.35, -3.0, {}};
  EXPECT_TRUE(takes_the_place(present, {1.35, -3.02, {}}));
  EXPECT_FALSE(takes_the_place(present, {1.36, -3.02, {}})) << "more on captures held out";
  EXPECT_FALSE(takes_the_place(present, {1.35, -3.005, {}})) << "chance";
  EXPECT_TRUE(takes_the_place(present, {1.16, -2.999, {}}));
  EXPECT_FALSE(takes_the_place(present, {1.16, -2.99, {}})) << "at the expense of the captures fitted to";
  EXPECT_FALSE(takes_the_place({1.05, -3.0, {}}, {0.98, -3.0, {}})) << "below the floor chance moves the score";
  EXPECT_FALSE(takes_the_place({9, -3.0, {}}, {8, -3.0, {}})) << "hardly less of what is left";
}

TEST(MakesBetter, WhatLowersTheHeldOutScoreOrTheProperOne) {
  const Left before{2, -3.0, {{"bias", true}}, 2};
  EXPECT_TRUE(makes_better(before, {1.97, -2.9, {}, 1.97}, {}));
  EXPECT_FALSE(makes_better(before, {1.99, -3.0, {}, 1.99}, {})) << "hardly less";
  EXPECT_TRUE(makes_better(before, {2.05, -3.02, {}, 2.05}, {}));
  EXPECT_FALSE(makes_better(before, {2.15, -3.02, {}, 2.15}, {})) << "at the expense of captures held out";
  EXPECT_FALSE(makes_better({0.9, -3.0, {}, 0.9}, {0.8, -2.99, {}, 0.8}, {})) << "chance, below the floor";
  EXPECT_FALSE(makes_better({2, -3.0, {}, 2}, {1.9, -2.99, {}, 1.9}, {})) << "nothing was unexplained";
}

TEST(MakesBetter, NextToNothingIsNoReasonUnlessTheProperScoreFallsToo) {
  const Left before{1.137, -4.0809, {}, 0.955};  // bumps in a noise that was right
  EXPECT_FALSE(makes_better(before, {1.133, -4.0800, {}, 0.949}, {}));
  EXPECT_TRUE(makes_better(before, {1.133, -4.0811, {}, 0.949}, {}));
  EXPECT_TRUE(makes_better(before, {1.126, -4.0800, {}, 0.949}, {}));
}

TEST(MakesBetter, WhatExplainsAllNeedOnlyLowerTheProperScoreWhereTheHeldOutOneHardlyMoves) {
  const Left before{1.187, -4.3148, {{"poses", true}, {"poses", false}}, 0.983};
  EXPECT_TRUE(makes_better(before, {1.193, -4.3195, {}, 0.980}, {}));
  EXPECT_FALSE(makes_better(before, {1.193, -4.3195, {{"poses", false}}, 0.980}, {}));
  EXPECT_FALSE(makes_better(before, {1.193, -4.3148, {}, 0.980}, {}));
  EXPECT_FALSE(makes_better(before, {1.3, -4.3195, {}, 0.980}, {}));
  EXPECT_FALSE(makes_better(before, {1.193, -4.3195, {}, 0.980}, {.unproven = true}));
}

TEST(MakesBetter, ALensThatStandsFurtherOffByChanceDoesNotOutweighAllElse) {
  // A strong smoothing that the model's own noise had made up for.
  EXPECT_TRUE(makes_better({1.04, -3.500, {}, 1.01}, {1.2, -3.519, {}, 1.02}, {}));
  EXPECT_FALSE(makes_better({1.04, -3.500, {}, 1.01}, {1.2, -3.519, {{"intrinsics", false}}, 1.02}, {}));
  EXPECT_FALSE(makes_better({1.04, -3.500, {}, 1.01}, {1.2, -3.509, {}, 1.02}, {}));
  EXPECT_FALSE(makes_better({1.04, -3.500, {}, 1.01}, {1.2, -3.519, {}, 1.12}, {}));
}

TEST(MakesBetter, WherePosesAloneAreOffABlurThatLetsThemComeBackIsNone) {
  const Leftovers poses{{"poses", true}, {"poses", false}}, fewer{{"poses", false}};
  EXPECT_FALSE(makes_better({1.194, -3.0283, poses, 0.91}, {1.155, -2.9955, poses, 0.90}, {}));
  EXPECT_TRUE(makes_better({1.194, -3.0283, poses, 0.91}, {1.155, -3.0283, poses, 0.90}, {}));
  EXPECT_TRUE(makes_better({1.194, -3.0283, {{"bias", true}}, 0.91}, {1.155, -2.9955, poses, 0.90}, {}));
  EXPECT_FALSE(makes_better({1.194, -3.0283, poses, 0.91}, {1.155, -2.9955, fewer, 0.90}, {.happens_or_not = true}));
  EXPECT_TRUE(makes_better({1.194, -3.0283, poses, 0.91}, {1.195, -3.0283, fewer, 0.90}, {.happens_or_not = true}));
}

TEST(MakesBetter, WhatBringsAllPosesBackMayRaiseTheProperScoreByLess) {
  const Left before{1.138, -3.791, {{"poses", true}, {"poses", false}}, 0.964};  // targets that move, and a delay
  EXPECT_TRUE(makes_better(before, {0.968, -3.787, {}, 0.961}, {}));
  EXPECT_FALSE(makes_better(before, {0.968, -3.787, {{"poses", false}}, 0.961}, {}));
  EXPECT_FALSE(makes_better(before, {0.968, -3.780, {}, 0.961}, {})) << "a blur";
}

TEST(MakesBetter, WhatDrawsHasToLowerTheProperScore) {
  const Left before{1.13, -3.012, {{"comb", true}}, 1.13};
  EXPECT_TRUE(makes_better(before, {1.08, -2.988, {{"comb", true}}, 1.08}, {}));
  EXPECT_FALSE(makes_better(before, {1.08, -2.988, {{"comb", true}}, 1.08}, {.draws = true}));
  EXPECT_TRUE(makes_better(before, {1.08, -3.02, {{"comb", true}}, 1.08}, {.draws = true}));
}

TEST(MakesBetter, BelowTheFloorWhatExplainsAllThatWasUnexplainedMayCostTwiceAsMuch) {
  const Left before{0.96, -3.53, {{"spectrum", true}}, 1.02};
  EXPECT_TRUE(makes_better(before, {0.91, -3.515, {}, 0.95}, {}));
  EXPECT_FALSE(makes_better(before, {0.91, -3.515, {{"spectrum", true}}, 0.95}, {}));
  EXPECT_FALSE(makes_better(before, {0.91, -3.505, {}, 0.95}, {}));
  EXPECT_FALSE(makes_better({0.96, -3.53, {}, 1.02}, {0.91, -3.515, {}, 0.95}, {}));
}

TEST(MakesBetter, WhatHadNotProvedItselfHasToTakeAQuarter) {
  const Left before{2, -3.0, {{"bias", true}}, 2};
  EXPECT_FALSE(makes_better(before, {1.8, -3.1, {}, 1.8}, {.unproven = true}));
  EXPECT_TRUE(makes_better(before, {1.7, -3.1, {}, 1.7}, {.unproven = true}));
  EXPECT_FALSE(makes_better({1.11, -3.0, {}, 1.11}, {1.07, -3.1, {}, 1.07}, {.unproven = true})) << "by chance";
}

TEST(MakesBetter, WhatHadNotProvedItselfMayExplainAllThatWasUnexplained) {
  const Left before{1.01, -4.172, {{"spectrum", true}}, 1.02};
  EXPECT_TRUE(makes_better(before, {0.94, -4.181, {}, 0.95}, {.unproven = true}));
  EXPECT_FALSE(makes_better(before, {0.94, -4.181, {{"spectrum", true}}, 0.95}, {.unproven = true}));
  EXPECT_FALSE(makes_better(before, {0.94, -4.172, {}, 0.95}, {.unproven = true}));
  EXPECT_FALSE(makes_better(before, {1.005, -4.181, {}, 0.95}, {.unproven = true})) << "not at the floor";
}

TEST(MakesBetter, AMapOfTheUnitAndWhatHappensOrNotAreJudgedByWhatScoresDoNotSay) {
  const Left before{2, -3.0, {{"time", true}, {"bias", true}}, 2};
  EXPECT_TRUE(makes_better(before, {2.2, -3.0, {}, 2.2}, {.by_its_map = true}));
  EXPECT_TRUE(makes_better(before, {2.2, -3.0, {{"bias", true}}, 2.2}, {.happens_or_not = true}));
  EXPECT_FALSE(makes_better(before, {2.2, -3.0, {{"edges", true}}, 2.2}, {.happens_or_not = true}));
}

TEST(MakesBetter, WhereTheLensMakesUpForWhatElseIsMissingTheStatisticsDecide) {
  const Left astray{18.4, -3.4, {{"bias", true}, {"intrinsics", true}}, 1.5};
  EXPECT_TRUE(makes_better(astray, {21.3, -5.1, {{"intrinsics", true}}, 1.0}, {}));
  EXPECT_FALSE(makes_better(astray, {21.3, -3.4, {{"intrinsics", true}}, 1.0}, {})) << "no better properly";
  EXPECT_FALSE(makes_better(astray, {21.3, -5.1, {{"intrinsics", true}}, 1.3}, {})) << "less than half of it";
  EXPECT_FALSE(makes_better(astray, {21.3, -5.1, {{"intrinsics", true}}, 1.0}, {.unproven = true}));
  EXPECT_FALSE(makes_better({1.5, -3.4, {{"bias", true}}, 1.6}, {5, -5.1, {}, 1.0}, {})) << "it had stood where stated";
}

TEST(AsGood, WhereNothingMoreIsUnexplained) {
  const Left present{1.1, -3.0, {{"edges", true}}};
  EXPECT_TRUE(as_good(present, {1.11, -2.9, {{"edges", true}}}));
  EXPECT_TRUE(as_good(present, {1.11, -2.9, {}}));
  EXPECT_FALSE(as_good(present, {1.11, -2.9, {{"bias", true}}}));
  EXPECT_FALSE(as_good(present, {1.13, -2.9, {}}));
}

TEST(DoesForTwo, WhatIsAsGoodAndHardlyWorseByTheProperScoreOrBetterByIt) {
  const Left two{1.1, -3, {{"edges", true}}};
  EXPECT_TRUE(does_for_two(two, {1.11, -2.999, {}}));
  EXPECT_FALSE(does_for_two(two, {1.11, -2.99, {}}));
  EXPECT_FALSE(does_for_two(two, {1.13, -2.999, {}}));
  EXPECT_TRUE(does_for_two(two, {1.13, -3.001, {}}));
  EXPECT_FALSE(does_for_two(two, {1.21, -3.01, {}}));
  EXPECT_TRUE(does_for_two(two, {1.09, -2.996, {}})) << "a scale for an offset of the disparity and one of depth";
  EXPECT_FALSE(does_for_two(two, {1.10, -2.996, {}}));
  EXPECT_FALSE(does_for_two(two, {1.09, -2.994, {}}));
  EXPECT_FALSE(does_for_two(two, {1.1, -3.01, {{"bias", true}}}));
}

TEST(TwoDoBetter, WhereTheCapturesHeldOutAreClearlyNearerToThem) {
  // An offset of the disparity and a bend of depth, called one long wave.
  const Left wave{1.164, -3.5242, {}};
  EXPECT_TRUE(two_do_better(wave, {1.101, -3.5225, {}}));
  EXPECT_FALSE(two_do_better(wave, {1.154, -3.5225, {}})) << "by chance";
  EXPECT_FALSE(two_do_better(wave, {1.101, -3.5175, {}})) << "the proper score is worse";
  EXPECT_FALSE(two_do_better(wave, {1.101, -3.5225, {{"bias", true}}})) << "something is left";
}

TEST(HardlyThere, BelowHalfOfTheLeastThatInstrumentsShow) {
  for (const EffectDeclaration* effect : effect_catalogue().all()) {
    const ParameterSpec* amplitude = effect->parameter(effect->amplitude);
    if (effect->user_defined || !amplitude) continue;
    for (const Strength strength : {Strength::weak, Strength::medium, Strength::strong})
      EXPECT_FALSE(hardly_there(*effect, strength_value(*effect, strength))) << effect->name;
    if (!effect->stronger_is_larger || amplitude->neutral != 0.0) {
      EXPECT_FALSE(hardly_there(*effect, amplitude->lower)) << effect->name;
      continue;
    }
    for (const double sign : {1.0, -1.0}) {
      EXPECT_TRUE(hardly_there(*effect, sign * 0.49 * amplitude->typical_low)) << effect->name;
      EXPECT_FALSE(hardly_there(*effect, sign * 0.51 * amplitude->typical_low)) << effect->name;
    }
  }
}

}  // namespace
}  // namespace binrig
