// The diagnosis asked about recordings whose truth is known: a small part of bench/hidden_effects.
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <numbers>
#include <regex>

#include "bench/hidden_effects/shot.h"
#include "bench/hidden_effects/study.h"
#include "core/progress.h"
#include "diagnose/hypotheses.h"
#include "diagnose/score.h"
#include "diagnose/screen.h"
#include "diagnose/unit_map.h"
#include "sim/effect.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

/// One scene and one set of signatures for all tests here, kept from process to process: each test is one of its own.
struct World {
  bench::SmallCampaign campaign{true};
  SimulationCache cache{BINRIG_TEST_CACHE, 512, true};
  const SceneForwardModel& forward() const { return campaign.forward(); }
};
World& world() {
  static World world;
  return world;
}

Diagnosis answer(const hidden::Case& c, int most_effects = 2) {
  DiagnosisOptions options;
  options.simulations = 20;
  options.most_effects = most_effects;
  return hidden::ask(world().forward(), hidden::make_truth(world().forward(), c), world().cache, options);
}

std::vector<std::string> names(const Diagnosis& diagnosis) {
  std::vector<std::string> list;
  for (const auto& candidate : diagnosis.candidates) list.push_back(candidate.effect);
  return list;
}

// Two implementations of each formula, written apart: what they make of the same instrument differs by the randomness
// of the recordings alone (mean square 1 in units of the catalogue's own scatter, 1.1 with the scatter of the mean of
// eight simulations; practical floors make it less). Beyond 2 one of the two is wrong.
TEST(HiddenData, AgreeWithTheCatalogueInEverySegment) {
  for (const char* effect :
       {"radial_distortion", "pixel_locking", "edge_fattening", "lateral_noise", "low_confidence", "second_shadow",
        "low_signal_noise", "heavy_tails", "noise_bumps", "vibration", "smoothing", "hole_filling",
        "disparity_quantisation", "temporal_filter", "border_band", "dust", "depth_units", "fronto_parallel_patches",
        "speckle_noise"}) {
    const auto truth = hidden::make_truth(world().forward(), {"one", {effect}, Strength::strong, 3});
    for (const auto& [segment, square] : hidden::disagreement(world().forward(), truth, world().cache, 8))
      EXPECT_LT(square, 2) << effect << ", " << segment;
  }
}

TEST(HiddenData, WhatLeavesNoTraceCountsForNoRate) {
  const hidden::Case c{"one", {"no_return"}, Strength::strong, 3};
  auto truth = hidden::make_truth(world().forward(), c);
  const auto traces_from = [&](double threshold) {
    truth.hidden[0].values["threshold"] = threshold;
    truth.recording =
        hidden::record(world().forward(), truth.instrument, truth.hidden, truth.offsets, truth.frames_seed);
    return hidden::traces_of(world().forward(), truth);
  };
  const auto of_dark_targets = traces_from(0.2), of_nothing = traces_from(1e-6);
  EXPECT_GT(of_dark_targets.at(0), 0);
  EXPECT_EQ(of_nothing.at(0), 0);

  Diagnosis answer;
  answer.verdict = Verdict::nothing_missing;
  const auto summary_with = [&](const std::vector<double>& traces) {
    const std::vector<nlohmann::json> lines(1, hidden::line_of(c, truth, traces, answer, 1));
    return hidden::summary_of(lines);
  };
  EXPECT_EQ(summary_with(of_dark_targets)["right_first"]["strong"]["of"], 1);
  EXPECT_EQ(summary_with(of_dark_targets)["no_trace_alarms"]["of"], 0);
  EXPECT_FALSE(summary_with(of_nothing).contains("right_first"));
  EXPECT_EQ(summary_with(of_nothing)["no_trace_alarms"]["of"], 1);
  EXPECT_EQ(summary_with(of_nothing)["no_trace_alarms"]["hits"], 0);
}

class HiddenEffect : public ::testing::TestWithParam<const char*> {};

TEST_P(HiddenEffect, IsNamedFirst) {
  const std::string effect = GetParam();
  const hidden::Case c{"one", {effect}, Strength::strong, 1};
  const Diagnosis diagnosis = answer(c, 1);  // whether anything is left is asked below and in the benchmark
  ASSERT_FALSE(diagnosis.candidates.empty()) << diagnosis.headline;
  EXPECT_EQ(diagnosis.candidates[0].effect, effect) << diagnosis.headline;
  const EffectDeclaration& declaration = find_effect(effect)->declaration;
  const Score &before = diagnosis.ladder[0].score, &after = diagnosis.ladder[1].score;
  if (declaration.parameter(declaration.amplitude)->kind == ParameterKind::chance) {
    // Whether it happens at all lies in the last model's randomness: on its scale nothing was wrong before.
    EXPECT_LT(after.proper, before.proper);
  } else if (!declaration.per_unit_map) {
    // Scores are of a typical unit: they know nothing of a map, which was recognised on the captures held out.
    EXPECT_LT(after.heldout, before.heldout);
  }
  // Values on either side of a step are ruled out one by one, however many recordings are asked.
  if (const ParameterSpec& step = *declaration.parameter(declaration.amplitude); is_step(declaration, step)) {
    const double truth = hidden::make_truth(world().forward(), c).hidden[0].values.at(step.name);
    const auto& ci95 = diagnosis.improved.find(diagnosis.candidates[0].id)->values.at(step.name).ci95;
    ASSERT_TRUE(ci95);
    EXPECT_LE((*ci95)[0], truth);
    EXPECT_GE((*ci95)[1], truth);
    EXPECT_LT((*ci95)[1] - (*ci95)[0], 0.02 * truth);
  }
}

INSTANTIATE_TEST_SUITE_P(OfTheCatalogue, HiddenEffect,
                         ::testing::Values("radial_distortion", "row_noise", "depth_offset", "disparity_quantisation",
                                           "dead_pixels", "mismatch_outliers", "frame_repeat"),
                         [](const auto& info) { return std::string(info.param); });

TEST(HiddenEffects, ARingInTheSpectrumIsToldFromTheModelsOwnNoise) {
  // Stronger than the noise that it is in: either could play the other's part.
  const hidden::Case c{"one", {"noise_bumps"}, Strength::strong, 72};
  const Diagnosis diagnosis = answer(c);
  EXPECT_EQ(names(diagnosis), std::vector<std::string>{"noise_bumps"});
  EXPECT_EQ(diagnosis.verdict, Verdict::missing_effect) << diagnosis.headline;
  const double truth = hidden::make_truth(world().forward(), c).hidden[0].values.at("amplitude");
  for (const auto& effect : diagnosis.improved.effects)
    if (effect.effect == "noise_bumps") {
      EXPECT_NEAR(effect.value("amplitude"), truth, 0.1 * truth);
    }
}

TEST(HiddenEffects, NothingHiddenNothingNamed) {
  const Diagnosis diagnosis = answer({"none", {}, Strength::medium, 1});
  EXPECT_TRUE(names(diagnosis).empty()) << diagnosis.headline;
  EXPECT_EQ(diagnosis.verdict, Verdict::nothing_missing) << diagnosis.headline;
}

TEST(HiddenEffects, AnEffectThatNoCatalogueHasIsUnknown) {
  const Diagnosis diagnosis = answer({"outside", {"step_across_a_line"}, Strength::strong, 1}, 1);
  EXPECT_EQ(diagnosis.verdict, Verdict::unknown_effect) << diagnosis.headline;
  ASSERT_FALSE(diagnosis.unexplained.empty());
}

/// A recording as the diagnosis first sees it: measured, the model that was given fitted in one pass.
struct FirstLook {
  hidden::Truth truth;
  Experiment experiment;
  std::vector<std::string> unreadable;
  Measurement measured;
  Rung rung;
  explicit FirstLook(const hidden::Case& c)
      : truth(hidden::make_truth(world().forward(), c)),
        experiment(world().forward(), truth.start, world().cache),
        measured(experiment.measure([&](int capture, int i) { return truth.recording[capture][i]; }, unreadable)),
        rung(fit_rung(experiment,
                      scene_motions(experiment, truth.start,
                                    registration_prior(world().forward().set(), experiment.nominal(0).camera)),
                      measured, truth.start, {}, {.simulations = 16, .passes = 1})) {}
};

TEST(Screen, AStepAcrossALineIsFoundWithItsPlaceAndHeight) {
  const FirstLook look({"outside", {"step_across_a_line"}, Strength::strong, 1});
  std::vector<Unexplained> entries(1);
  entries[0].segment = "bias";
  for (const auto& fit : goodness_of_fit(look.experiment.layout(), look.rung))
    if (fit.segment == "bias" && fit.train) entries[0].ratio = fit.ratio;
  screen(look.experiment, look.rung, look.measured.all, entries);

  std::smatch found;
  ASSERT_TRUE(
      std::regex_search(entries[0].formula, found, std::regex(R"(x\*(-?[\d.]+) \+ y\*(-?[\d.]+) > (-?[\d.]+))")))
      << entries[0].shape << entries[0].formula;
  double along_x = std::stod(found[1]), along_y = std::stod(found[2]), place = std::stod(found[3]);
  ASSERT_TRUE(std::regex_search(entries[0].formula, found, std::regex(R"(\{a: (-?[\d.e-]+)\})")));
  double height = std::stod(found[1]);
  auto values = look.truth.hidden.at(0).values;
  if (along_x * std::cos(values["angle"]) + along_y * std::sin(values["angle"]) < 0)  // the same line from behind
    along_x *= -1, along_y *= -1, place *= -1, height *= -1;
  // A bin is 2 px, 0.031 of half the width: so well a line is known, and over half the image's height to 0.042 rad.
  EXPECT_NEAR(std::remainder(std::atan2(along_y, along_x) - values["angle"], 2 * std::numbers::pi), 0, 0.042);
  EXPECT_NEAR(place, values["place"], 0.031);
  // Poses lean into a step; how far is known to their prior only.
  EXPECT_NEAR(height, values["amplitude"], 0.2 * std::abs(values["amplitude"]));

  // Pasted, it is a model; and what is found beside it can be pasted beside it.
  const auto pasted = [](const std::string& formulas) {
    return parse_sensor_model("effects:\n" + formulas, "pasted", effect_catalogue());
  };
  Rung beside = look.rung;
  add_effect(beside.model, effect_catalogue(), pasted(entries[0].formula).effects.at(0));
  std::vector<Unexplained> second(1);
  second[0].segment = "bias", second[0].ratio = entries[0].ratio;
  screen(look.experiment, beside, look.measured.all, second);
  EXPECT_EQ(pasted(entries[0].formula + "\n" + second[0].formula).effects.at(1).id, "unexplained_2");
}

/// The pattern of a unit that a recording shows, fitted to what is left at first.
struct FittedPattern {
  static constexpr std::uint64_t seed = 7;
  Hypotheses all;
  const Hypothesis& pattern;
  UnitMapFit fit;
  explicit FittedPattern(const FirstLook& look)
      : all(make_hypotheses(world().forward(), look.truth.start)),
        pattern(*std::ranges::find(all.tested, "fixed_pattern_noise", &Hypothesis::effect)),
        fit(fitted(look)) {}

 private:
  UnitMapFit fitted(const FirstLook& look) const {
    const auto& start = pattern.paths[0].atoms[0].values;
    const auto units_of = [&](const SensorModel& model) {
      return look.experiment.simulate(UnitMap::trials_of(look.rung, model, seed), "");
    };
    const auto without = units_of(look.rung.model);
    UnitMap map(look.experiment.layout(), look.rung, without,
                units_of(with_effect(look.rung.model, effect_catalogue(), pattern.effect, start)));
    return fit_unit_map(look.experiment, look.rung, pattern, start, std::move(map), without, seed);
  }
};

TEST(UnitMap, LengthAndStrengthOfAHiddenPatternAreReadOffIt) {
  // The second one is so strong that its neighbours among the lengths that are tried are far less likely, and that
  // values fall on other steps with it than without.
  for (const auto& [strength, seed] : {std::pair(Strength::medium, 2), std::pair(Strength::strong, 9943)}) {
    const FirstLook look({"one", {"fixed_pattern_noise"}, strength, static_cast<std::uint64_t>(seed)});
    const FittedPattern found(look);
    const auto deviation =
        unit_map_deviations(look.experiment, look.rung, found.pattern, found.fit, FittedPattern::seed);
    EXPECT_TRUE(found.fit.map.looks_random(look.rung.rest)) << seed;
    for (const auto& [name, value] : look.truth.hidden.at(0).values) {
      ASSERT_TRUE(deviation.count(name)) << name;
      EXPECT_LT(deviation.at(name), 0.3) << name;
      EXPECT_NEAR(std::log(found.fit.values.at(name) / value), 0, 3 * deviation.at(name))
          << seed << " " << name << " " << value;
    }
  }
}

TEST(UnitMap, ASpiralIsNoPatternWhateverItsTexture) {
  // Its frequencies are those of a smooth map, nearly: four units say too little of what such a map has of each.
  const FirstLook look({"outside", {"spiral"}, Strength::medium, 9936});
  EXPECT_FALSE(FittedPattern(look).fit.map.looks_random(look.rung.rest));
}

TEST(ColouredNoise, MovesWholeFramesByAsMuchAsItsSpectrumSays) {
  // White: the mean of n pixels has a variance of 1/n. Its sum over 200 frames has a standard deviation of 0.1.
  constexpr int frames = 200;
  const cv::Size size(16, 12);
  hidden::Dice dice(RandomStream(5).child("coloured noise"));
  double square = 0;
  for (int i = 0; i < frames; ++i)
    square += std::pow(cv::mean(hidden::coloured_noise(size, dice, [](double, double) { return 1.0; }))[0], 2);
  EXPECT_NEAR(square / frames * size.area(), 1, 0.4);
}

// A model cannot look better by becoming noisier: on the ladder's scale, whichever of the two models it is frozen at.
TEST(Ladder, RandomnessThatIsNotThereNeverScoresBetter) {
  const SceneForwardModel& forward = world().forward();
  const SensorModel right = bench::five_effect_model();
  // Every target where it nominally is, so that there is nothing to fit.
  const std::vector<Offset> nominal(forward.captures().size());
  const auto recording = bench::simulated_recording(forward, right, nominal, 5);
  const Experiment experiment(forward, right, world().cache);
  std::vector<std::string> unreadable;
  const Measurement measured = experiment.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
  const auto motions =
      scene_motions(experiment, right, registration_prior(forward.set(), experiment.nominal(0).camera));
  const RungOptions as_given{.simulations = 16, .passes = 0};
  std::vector<Rung> rungs{fit_rung(experiment, motions, measured, right, {}, as_given)};

  SensorModel shaking = right, patterned = right, noisy = right;
  add_effect(shaking, effect_catalogue(), "vibration", {{"amplitude", 0.12}});
  add_effect(patterned, effect_catalogue(), "fixed_pattern_noise", {{"amplitude", 0.1}});
  for (auto& effect : noisy.effects)
    if (effect.effect == "spectral_noise") effect.values["sigma"].value *= 2;
  for (const SensorModel& worse : {shaking, patterned, noisy}) {
    rungs.resize(1);
    rungs.push_back(fit_rung(experiment, motions, measured, worse, {}, as_given));
    for (const Rung& scale : rungs) {
      const auto judged = scores(experiment.layout(), motions, scale, measured.all, {&rungs[0], &rungs[1]});
      EXPECT_GT(judged[1].heldout, judged[0].heldout) << worse.effects.back().id;
      EXPECT_GT(judged[1].proper, judged[0].proper) << worse.effects.back().id;
    }
  }
}

}  // namespace
}  // namespace binrig
