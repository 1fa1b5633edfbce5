// What users are told: from results to sentences, without any simulation.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnose/diagnose.h"
#include "diagnose/search_result.h"
#include "sim/effect.h"

namespace binrig {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

Diagnosis one_added(double bias_before_mm, double bias_after_mm) {
  Diagnosis diagnosis;
  diagnosis.verdict = Verdict::missing_effect;
  diagnosis.candidates.resize(1);
  diagnosis.candidates[0].effect = diagnosis.candidates[0].id = "depth_offset";
  diagnosis.ladder.resize(2);
  diagnosis.ladder[0].score.heldout = 3.14;
  diagnosis.ladder[0].score.bias_rms_mm = bias_before_mm;
  diagnosis.ladder[1].score.heldout = 1.04;
  diagnosis.ladder[1].score.bias_rms_mm = bias_after_mm;
  return diagnosis;
}

TEST(Words, TheHeadlineNamesTheEffectAndHowFarTheErrorFalls) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, HasSubstr("lacks depth_offset"));
  EXPECT_THAT(diagnosis.headline, HasSubstr("from 3.1 to 1 "));
  EXPECT_THAT(diagnosis.headline, HasSubstr("mean depth error from 0.61 to 0.08 mm"));
}

TEST(Words, AMeanDepthErrorThatStaysIsNotMentioned) {
  Diagnosis diagnosis = one_added(0.080, 0.079);  // it was the noise that changed
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("mean depth error")));
}

TEST(Words, AnErrorThatDoesNotFallIsNotSoldAsAFall) {
  Diagnosis diagnosis = one_added(0.08, 0.08);
  diagnosis.ladder[1].score.heldout = 3.16;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("takes the error")));
  EXPECT_THAT(diagnosis.headline, HasSubstr("stays where it was (3.14, then 3.16"));
}

TEST(Words, AFallThatTheDigitsDoNotShowIsNoFall) {
  Diagnosis diagnosis = one_added(0.08, 0.08);  // noise in a small spot
  diagnosis.ladder[0].score.heldout = 1.103;
  diagnosis.ladder[1].score.heldout = 1.098;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, HasSubstr("stays where it was (1.10, then 1.10"));
}

TEST(Words, ALargeErrorIsNoPowerOfTen) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  diagnosis.ladder[0].score.heldout = 123.4;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, HasSubstr("from 123 to 1 "));
}

TEST(Words, AnEffectThatCapturesContradictEachOtherAboutStandsForSomethingElse) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.reasons, Not(Contains(HasSubstr("contradict"))));
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.candidates[0].differs = true;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.reasons, Contains(HasSubstr("depth_offset: captures contradict each other")));
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("depth_offset"))) << "it is not the cause";
}

TEST(Words, WhatMayAsWellBeNothingIsNotInTheHeadline) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.candidates.resize(2);
  diagnosis.candidates[1].effect = diagnosis.candidates[1].id = "noise_bumps";
  diagnosis.candidates[1].may_be_nothing = true;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, HasSubstr("Most of what is missing looks like depth_offset:"));
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("noise_bumps")));
  EXPECT_THAT(diagnosis.reasons,
              Contains(HasSubstr("noise_bumps: was added, but its strength may as well be nothing")));
}

TEST(Words, WhereADoubtfulEffectLeavesNothingUnexplainedNoKnownOneIsSaidToFail) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.candidates[0].may_be_nothing = true;
  Diagnosis something_left = diagnosis;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, HasSubstr("this recording does not show what"));
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("no known effect explains")));
  EXPECT_THAT(diagnosis.reasons, Contains(HasSubstr("its strength may as well be nothing")));
  something_left.unexplained.resize(1);
  something_left.unexplained[0].segment = "spectrum";
  put_into_words(something_left, effect_catalogue(), {});
  EXPECT_EQ(something_left.headline, "Something is missing that no known effect explains; it shows in spectrum.");
}

TEST(Words, WhatNoHeldOutCaptureShowsIsSaidWithTheCaptureToRecord) {
  Diagnosis diagnosis;
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.unconfirmed = {{"low_signal_dropout", "train/8 chart"}};
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.advice, Contains(testing::AllOf(HasSubstr("low_signal_dropout"), HasSubstr("train/8 chart"),
                                                        HasSubstr("split test"))));
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("low_signal_dropout"))) << "it is no finding";
}

TEST(Words, WhatExplainsMostIsNamedFirstAndWhatExplainsLittleIsNoCause) {
  Diagnosis most = one_added(0.61, 0.08);
  most.verdict = Verdict::unknown_effect;
  most.unexplained.resize(1);
  most.unexplained[0].segment = "spectrum";
  Diagnosis little = most;
  little.ladder[1].score.heldout = 1.43;  // four fifths of the way from 3.14 to the floor would be 1.428
  put_into_words(most, effect_catalogue(), {});
  EXPECT_THAT(most.headline, HasSubstr("Most of what is missing looks like depth_offset"));
  EXPECT_THAT(most.headline, HasSubstr("What is left no known effect explains; it shows in spectrum"));
  EXPECT_THAT(most.reasons, Not(Contains(HasSubstr("for the cause"))));
  put_into_words(little, effect_catalogue(), {});
  EXPECT_THAT(little.headline, Not(HasSubstr("depth_offset")));
  EXPECT_THAT(little.reasons, Contains(HasSubstr("Do not take it for the cause")));
}

TEST(Words, AStepThatWasReadOffTheValuesIsAFactWhateverElseIsMissing) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.ladder[1].score.heldout = 2;
  CandidateReport& step = diagnosis.candidates[0];
  step.effect = step.id = "disparity_quantisation";
  FitParameter parameter;
  parameter.id = step.id, parameter.name = "step", parameter.unit = "px";
  step.parameters = {{parameter, ParameterValue{0.0625}}};
  Diagnosis read = diagnosis;
  read.candidates[0].read_off = true;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.reasons, Not(Contains(HasSubstr("come in steps"))));
  put_into_words(read, effect_catalogue(), {});
  EXPECT_THAT(read.reasons, Contains(HasSubstr("come in steps of 0.0625 px")));
}

TEST(Words, WhatWasTakenOutAgainIsNotNamed) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.as_many_as_allowed = true;
  diagnosis.candidates.clear();
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_EQ(diagnosis.headline, "Something is missing that no known effect explains.");
}

TEST(Words, WhatWasNotLookedForIsNotSaidToBeUnknown) {
  Diagnosis diagnosis = one_added(0.61, 0.08);
  diagnosis.verdict = Verdict::unknown_effect;
  diagnosis.as_many_as_allowed = true;
  diagnosis.unexplained.resize(1);
  diagnosis.unexplained[0].segment = "spectrum";
  Diagnosis little = diagnosis;
  little.ladder[1].score.heldout = 2;
  put_into_words(diagnosis, effect_catalogue(), {});
  EXPECT_THAT(diagnosis.headline, HasSubstr("Something is left, and no others were to be added"));
  EXPECT_THAT(diagnosis.headline, Not(HasSubstr("no known effect")));
  put_into_words(little, effect_catalogue(), {});
  EXPECT_THAT(little.headline, HasSubstr("More is missing than depth_offset, and no others were to be"));
}

Refined gains(double train, double test, double shown_on_test) {
  Refined refined;
  refined.train_gain = train;
  refined.test_gain = test;
  refined.shown_on_test = shown_on_test;
  return refined;
}

TEST(SearchResult, WhatTestCannotShowIsUnconfirmedAndWhatItContradictsIsNot) {
  const SearchOptions options;
  SearchResult found;
  found.refined = {gains(500, 400, 420), gains(500, 0.1, 0.3), gains(500, -300, 280), gains(3, 0, 0)};
  ASSERT_EQ(found.accepted(options).size(), 1u);
  EXPECT_EQ(found.accepted(options)[0], &found.refined[0]);
  ASSERT_EQ(found.unconfirmed(options).size(), 1u);
  EXPECT_EQ(found.unconfirmed(options)[0], &found.refined[1]) << "the third fails on test, the fourth is chance";
  ASSERT_EQ(found.unproven(options).size(), 1u);
  EXPECT_EQ(found.unproven(options)[0], &found.refined[2]) << "what fails beside bent parameters is fitted with them";
  found.refined[2].gate = 260;
  EXPECT_TRUE(found.unproven(options).empty()) << "but only where train leaves no doubt";
}

}  // namespace
}  // namespace binrig
