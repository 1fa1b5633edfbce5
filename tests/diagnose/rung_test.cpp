// Fits of all parameters together, on recordings whose truth is known.
#include "diagnose/rung.h"

#include <cmath>
#include <map>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnose/comb.h"
#include "diagnose/score.h"
#include "diagnose/step_reader.h"
#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

TEST(FitRung, FollowsAValleyAlongWhichTwoParametersMakeUpForEachOther) {
  // Another wavelength with the phase that goes with it is the same wave at one distance, and nearly so at others:
  // slopes to one side promise nothing long before the bottom.
  constexpr double pi = std::numbers::pi, z_mm = 700, right = 396.5, wrong = 380, phase = 2.66;
  const double its_phase = std::remainder(phase + 4 * pi * z_mm * (1 / right - 1 / wrong), 2 * pi);
  const Case c(model_with("tof_wiggling", {{"amplitude", 1.8}, {"wavelength", right}, {"phase", phase}}),
               model_with("tof_wiggling", {{"amplitude", 1.7}, {"wavelength", wrong}, {"phase", its_phase}}));
  const Rung rung = c.fitted({.simulations = 16});
  const EffectInstance& found = *rung.model.find("tof_wiggling");
  // Within a fifth of the way from the start; chance is a tenth of that.
  EXPECT_NEAR(found.value("wavelength"), right, 3);
  EXPECT_NEAR(std::remainder(found.value("phase") - phase, 2 * pi), 0, 0.2);
  EXPECT_NEAR(found.value("amplitude"), 1.8, 0.03);
}

TEST(FitRung, FindsAWidthThatLiesBetweenTwoPixels) {
  // No pixel is further than 1.5 and no further than 1.6 px from an edge: a small step moves nothing, and with the
  // wrong width the probability makes up for it.
  const Case c(model_with("flying_pixels", {{"probability", 0.65}, {"width", 1.95}}),
               model_with("flying_pixels", {{"probability", 0.4}, {"width", 1.5}}));
  const Rung rung = c.fitted({.simulations = 16});
  const EffectInstance& found = *rung.model.find("flying_pixels");
  EXPECT_NEAR(found.value("width"), 1.95, 0.25);
  const Eigen::VectorXd half = half_intervals(rung.fit, rung.dispersion);
  int probability = 0;
  while (probability < half.size() && rung.fit.parameters[probability].name != "probability") ++probability;
  ASSERT_LT(probability, half.size());
  EXPECT_LT(half[probability], 0.2);                                       // it is determined
  EXPECT_NEAR(found.value("probability"), 0.65, 2.5 * half[probability]);  // five standard deviations
}

TEST(FitRung, FindsAThresholdThatOneCaptureOnlyIsBeyondHoweverFarItIsFromTheModel) {
  // The tilted plane is gone in the recording and there in the model; all others say nothing of the threshold.
  const Case c(model_with("low_confidence", {{"threshold", 40}}), model_with("low_confidence", {{"threshold", 58}}));
  const Rung rung = c.fitted({.simulations = 16});
  EXPECT_LT(rung.dispersion, 1.5);
  EXPECT_LT(rung.model.find("low_confidence")->value("threshold"), 45);
}

TEST(FitRung, MakesNoDropOutsEverywhereOfTheBorderOfAMask) {
  // Every 140th pixel is missing; a highlight's border as wide as all light would do that, too.
  const Case c(model_with("random_dropout", {{"rate", 0.007}}),
               model_with("specular_saturation", {{"threshold", 0.65}, {"disturbance", 0.04}}));
  const Rung rung = c.fitted({.simulations = 16});
  EXPECT_LT(rung.model.find("specular_saturation")->value("disturbance"), 0.1);
}

TEST(FitRung, FindsAWholeNumberThatAnotherParameterMadeUpFor) {
  // In a window that is too small a longer reach smooths as much: from there the right window alone is worse.
  const auto blur = [](double diameter, double sigma_px) {
    return model_with("bilateral_blur", {{"diameter", diameter}, {"sigma_px", sigma_px}, {"sigma_z", 3.5}});
  };
  const Case c(blur(7, 1.5), blur(5, 1.8));
  const Rung rung = c.fitted({.simulations = 16});
  const EffectInstance& found = *rung.model.find("bilateral_blur");
  EXPECT_EQ(static_cast<int>(found.value("diameter")) / 2, 3);  // an even diameter is the odd one above it
  EXPECT_NEAR(found.value("sigma_px"), 1.5, 0.05);
}

TEST(FitRung, MovesALobeAsFarAsTheDataPullIt) {
  // Its place is looked for in steps of a fraction of an image; the last of the way goes together with its width.
  const auto lobe = [](double x, double y, double radius) {
    return model_with("ambient_noise", {{"amplitude", 1.4}, {"centre_x", x}, {"centre_y", y}, {"radius", radius}});
  };
  const Case c(lobe(-0.58, 0.33, 0.66), lobe(-0.45, 0.15, 0.5));
  const Rung rung = c.fitted({.simulations = 16});
  const EffectInstance& found = *rung.model.find("ambient_noise");
  const Eigen::VectorXd half = half_intervals(rung.fit, rung.dispersion);
  for (int p = 0; p < half.size(); ++p) {
    const FitParameter& parameter = rung.fit.parameters[p];
    if (parameter.id != "ambient_noise") continue;
    const double truth = c.truth.find("ambient_noise")->value(parameter.name);
    EXPECT_LT(half[p], 0.3) << parameter.name;
    EXPECT_NEAR(parameter.scaled(found.value(parameter.name)), parameter.scaled(truth), 2.5 * half[p])
        << parameter.name;  // five standard deviations
  }
}

TEST(ParametersBent, AreThoseFarFromWhereTheUserPutThemWhereverPriorsStand) {
  const SensorModel given = model_with("radial_distortion", {{"amplitude", 0.5}});
  Rung rung;
  rung.model = given;
  rung.fit.parameters = fit_parameters(given, effect_catalogue());
  rung.fit.paused.assign(rung.fit.parameters.size(), false);
  EXPECT_TRUE(parameters_bent(rung, given, 1).empty());
  FitParameter& moved = rung.fit.parameters[0];
  value_in(rung.model, moved.id, moved.name).value =
      moved.natural(moved.scaled(given.find(moved.id)->value(moved.name)) + 1.1 * moved.prior_sigma);
  moved.prior_centre += 1.1 * moved.prior_sigma;  // as after a last fit
  EXPECT_THAT(parameters_bent(rung, given, 1), testing::ElementsAre(moved.id + "." + moved.name));
  EXPECT_TRUE(parameters_bent(rung, given, 1.2).empty());
  moved.narrow = true;
  EXPECT_TRUE(parameters_bent(rung, given, 1).empty());
  moved.narrow = false;
  rung.fit.paused[0] = true;
  EXPECT_TRUE(parameters_bent(rung, given, 1).empty()) << "the data do not know it";
  rung.fit.paused[0] = false;
  EXPECT_TRUE(parameters_bent(rung, without_effect(given, moved.id), 1).empty()) << "it was added";
}

TEST(UnfittedRung, SaysWhatTheFittedOneDoesAndThatWithoutAnEffectMuchIsLeft) {
  const SensorModel right = model_with("radial_distortion", {{"amplitude", 0.5}});
  const Case c(right, right);
  const RungOptions options{.simulations = 16};
  const Rung fitted = c.fitted(options);
  SensorModel lacking = fitted.model;
  lacking.effects.pop_back();
  const auto unfitted = [&](const SensorModel& model) {
    return unfitted_rung(c.experiment, c.motions, c.measured, model, fitted.offsets, options);
  };
  const Rung same = unfitted(fitted.model), without = unfitted(lacking);
  const auto judged = scores(c.experiment.layout(), c.motions, fitted, c.measured.all, {&fitted, &same, &without});
  EXPECT_NEAR(judged[1].heldout, judged[0].heldout, 0.05);
  EXPECT_GT(judged[2].heldout, judged[0].heldout + 1);

  // Left behind on the ladder, a rung is scored as before.
  Rung left_behind = without;
  leave_behind(left_behind);
  const auto again = scores(c.experiment.layout(), c.motions, fitted, c.measured.all, {&left_behind});
  EXPECT_EQ(again[0].heldout, judged[2].heldout);
  EXPECT_EQ(again[0].proper, judged[2].proper);
  EXPECT_EQ(again[0].bias_rms_mm, judged[2].bias_rms_mm);
}

TEST(Scores, TakeNoTargetThatStandsElsewhereForABias) {
  const SensorModel right = noise_alone(0.3);
  const Case c(right, right);
  const RungOptions options{.simulations = 16, .passes = 0};
  std::vector<Offset> astray(c.experiment.layout().captures);
  for (Offset& offset : astray) offset.pose[5] = 1;  // mm, three times the noise of a pixel
  const Rung nominal = c.fitted(options), off = fit_rung(c.experiment, c.motions, c.measured, c.start, astray, options);
  const auto judged = scores(c.experiment.layout(), c.motions, nominal, c.measured.all, {&nominal, &off});
  EXPECT_LT(judged[0].bias_rms_mm, 0.3);
  EXPECT_NEAR(judged[1].bias_rms_mm, judged[0].bias_rms_mm, 0.1 * judged[0].bias_rms_mm);
}

TEST(CombSteps, FindsTheToothThatAFitBesideItDoesNot) {
  // 0.09 px are 1.2 mm at 800 mm, four times the noise. A hundred teeth within the range: 0.7 % beside, most of them
  // meet others.
  const Case c(model_with("disparity_quantisation", {{"step", 0.09}}),
               model_with("disparity_quantisation", {{"step", 0.0906}}));
  Rung rung = c.fitted({.simulations = 16, .fixed = {"disparity_quantisation.step"}});
  const auto unexplained_on_train = [&] {
    Leftovers left = unexplained(c.experiment.layout(), rung);
    std::erase_if(left, [](const auto& one) { return !one.second; });
    return left;
  };
  EXPECT_FALSE(unexplained_on_train().empty()) << "noise is bent until the whole looks right, but not each statistic";
  comb_steps(c.experiment, c.motions, c.measured, c.start, {}, {.simulations = 16}, rung);
  EXPECT_NEAR(rung.model.find("disparity_quantisation")->value("step"), 0.09, 0.09 * 0.0005);
  EXPECT_LT(rung.dispersion, 1.1);
  EXPECT_THAT(unexplained_on_train(), testing::IsEmpty());
}

TEST(CombSteps, TriesWhatTheRecordedValuesSay) {
  // Beyond the reach of the comb.
  const Case c(model_with("depth_units", {{"step", 0.5}}), model_with("depth_units", {{"step", 0.53}}));
  const SeenSteps seen = seen_steps(simulated_values(c.experiment, c.truth),
                                    simulated_values(c.experiment, without_steps(c.start, effect_catalogue())));
  ASSERT_FALSE(seen.depth_mm.empty());
  const RungOptions options{.simulations = 16};
  const auto combed = [&](const SeenSteps& tried) {
    Rung rung = c.fitted(options);
    comb_steps(c.experiment, c.motions, c.measured, c.start, tried, options, rung);
    return rung.model.find("depth_units")->value("step");
  };
  EXPECT_NEAR(combed(seen), 0.5, seen.depth_mm[0].uncertainty);
  EXPECT_GT(std::abs(combed({}) - 0.5), 5 * seen.depth_mm[0].uncertainty) << "the comb alone finds it: no test";
}

TEST(MayBeNothing, WhereTheIntervalOfItsStrengthHoldsTheNeutralValue) {
  const EffectDeclaration& scale = find_effect("depth_scale")->declaration;
  FitParameter amplitude, other;
  amplitude.id = other.id = "scale";
  amplitude.lower = other.lower = -1;
  amplitude.upper = other.upper = 1;
  amplitude.name = scale.amplitude;
  other.name = "other";
  const double neutral = *scale.parameter(scale.amplitude)->neutral;
  const auto with = [&](const FitParameter& parameter, double value) {
    Fit fit;
    fit.parameters = {parameter};
    fit.value = Eigen::VectorXd::Constant(1, value);
    return fit;
  };
  const Eigen::VectorXd half = Eigen::VectorXd::Constant(1, 0.01);
  EXPECT_TRUE(may_be_nothing(with(amplitude, neutral + 0.009), half, "scale", scale));
  EXPECT_TRUE(may_be_nothing(with(amplitude, neutral - 0.009), half, "scale", scale));
  EXPECT_FALSE(may_be_nothing(with(amplitude, neutral + 0.011), half, "scale", scale));
  EXPECT_FALSE(may_be_nothing(with(amplitude, neutral), half, "another", scale));
  EXPECT_FALSE(may_be_nothing(with(other, neutral), half, "scale", scale)) << "its strength was not fitted";
  EXPECT_FALSE(may_be_nothing({}, half, "scale", scale));
}

}  // namespace
}  // namespace binrig
