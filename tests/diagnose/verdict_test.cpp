#include "diagnose/verdict.h"

#include <gtest/gtest.h>

namespace binrig {
namespace {

Evidence with(std::vector<Evidence::Accepted> accepted) {
  Evidence evidence;
  evidence.accepted = std::move(accepted);
  return evidence;
}

TEST(Verdict, NothingAcceptedAndNothingLeftIsNothingMissing) { EXPECT_EQ(judge(Evidence{}), Verdict::nothing_missing); }

TEST(Verdict, AConfirmedEffectIsMissing) {
  EXPECT_EQ(judge(with({{"a", false, true, {}}})), Verdict::missing_effect);
  EXPECT_EQ(judge(with({{"a", true, true, {}}})), Verdict::missing_effect) << "a random map may be called one";
}

TEST(Verdict, ARivalThatTheDataCannotTellApartConfounds) {
  EXPECT_EQ(judge(with({{"a", false, true, {"b"}}})), Verdict::confounded);
  EXPECT_EQ(judge(with({{"a", false, true, {}}, {"c", false, true, {"d"}}})), Verdict::confounded);
}

TEST(Verdict, WhateverStaysUnexplainedIsUnknownHoweverWellANameFits) {
  Evidence evidence = with({{"a", false, true, {}}});
  evidence.unexplained_segments = {"bias"};
  EXPECT_EQ(judge(evidence), Verdict::unknown_effect);
  evidence.unexplained_segments.clear();
  evidence.screen_finds_something = true;
  EXPECT_EQ(judge(evidence), Verdict::unknown_effect);
  Evidence nothing;
  nothing.unexplained_segments = {"noise"};
  EXPECT_EQ(judge(nothing), Verdict::unknown_effect);
}

TEST(Verdict, AMapWithAShapeIsNoRandomMap) {
  EXPECT_EQ(judge(with({{"a", true, false, {}}})), Verdict::unknown_effect);
}

TEST(Verdict, AnEffectThatIsDoubtfulIsNotTheCause) {
  EXPECT_EQ(judge(with({{"a", false, true, {}}, {"b", false, true, {}, true}})), Verdict::unknown_effect);
  EXPECT_EQ(judge(with({{"a", false, true, {"c"}, true}})), Verdict::unknown_effect) << "nor is what looks like it";
}

TEST(Verdict, WithoutDataNothingIsNamed) {
  Evidence evidence = with({{"a", false, true, {}}});
  evidence.unexplained_segments = {"bias"};
  evidence.lacking = {"a capture to hold out"};
  EXPECT_EQ(judge(evidence), Verdict::not_enough_data);
}

}  // namespace
}  // namespace binrig
