#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// A model with one formula, as a user writes it.
SensorModel model_with(const std::string& formula) {
  return parse_sensor_model("name: own\nprojector: {x: 75}\neffects:\n  - formula: {" + formula + "}\n", "own.yaml",
                            effect_catalogue());
}

struct Result {
  cv::Mat depth, reason, perfect;
};

Result run(const std::string& formula, const test::AnalyticScene& scene, bool power_on = true) {
  const SensorModel model = model_with(formula);
  CaptureContext context = test::analytic_context(scene, test::small_camera());
  context.depth_scale_mm = 0;
  context.power_on = power_on;
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  FrameInstant instant{3, 0.3, power_on ? 0.3 : std::numeric_limits<double>::infinity()};
  SensorRun sensor(model, context);
  const Frame frame = sensor.frame(*channels, instant);
  frame.check("frame");
  return {frame.depth_mm, frame.reason, channels->depth_mm};
}

std::string refusal(const std::string& formula) {
  try {
    run(formula, test::plane_scene(800));
  } catch (const Error& error) {
    return error.what();
  }
  return "was accepted";
}

TEST(Formula, IsTheEffectOfTheCatalogueWithTheSameFormula) {
  // radial_distortion written by hand.
  const Result own =
      run("on: disparity, expression: \"a*r2\", parameters: {a: {value: 0.2, unit: px}}", test::plane_scene(800));
  const cv::Mat built_in = test::depth_under("radial_distortion", {{"amplitude", 0.2}}, test::plane_scene(800));
  EXPECT_LT(cv::norm(own.depth, built_in, cv::NORM_INF), 3e-4);
}

TEST(Formula, SeesEveryChannelAsDocumented) {
  const test::AnalyticScene scene = test::mixed_scene();
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  const cv::Point places[] = {{20, 30}, {110, 62}, {80, 100}};
  const ImageCoordinates image(context.camera);
  for (const cv::Point& p : places) {
    const double z = channels->depth_mm.at<float>(p);
    ASSERT_GT(z, 0);
    const std::pair<const char*, double> expected[] = {{"z", z},
                                                       {"d", 200 * 75 / z},
                                                       {"x", image.x(p.x)},
                                                       {"y", image.y(p.y)},
                                                       {"r2", image.r2(p.x, p.y)},
                                                       {"r", std::sqrt(image.r2(p.x, p.y))},
                                                       {"u", p.x},
                                                       {"v", p.y},
                                                       {"theta", std::acos(channels->cos_incidence.at<float>(p))},
                                                       {"I", channels->ir.at<float>(p)},
                                                       {"e", channels->edge_px.at<float>(p)},
                                                       {"c", channels->crease_px.at<float>(p)},
                                                       {"t", 0.3},
                                                       {"z0", 800},
                                                       {"n", 3}};
    for (const auto& [name, value] : expected) {
      const Result result = run(std::string("expression: \"100 + ") + name + "\"", scene);
      EXPECT_NEAR(result.depth.at<float>(p) - z, 100 + value, 2e-4 * std::max(1.0, std::abs(value))) << name;
    }
  }
}

TEST(Formula, ActsOnTheNoise) {
  // (1 + 2 x^0) sigma: three times the noise.
  const SensorModel model = parse_sensor_model(
      "effects:\n  - formula: {stage: amplitude, on: sigma, expression: \"b\", parameters: {b: 2}}\n"
      "  - spectral_noise: {sigma: 0.5, white_share: 1, correlation_length: 0}\n",
      "own.yaml", effect_catalogue());
  CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  context.depth_scale_mm = 0;
  const auto channels = test::analytic_channels(test::plane_scene(800), context.camera, context.projector_xyz_mm, 800);
  const Frame frame = SensorRun(model, context).frame(*channels, {});
  EXPECT_NEAR(test::mean_and_deviation(frame.depth_mm).second, 1.5, 0.03);
}

TEST(Formula, DivisionByZeroAtSomePixelsMakesHolesThereAndNoNaN) {
  const Result result = run("expression: \"1/(u - 40)\"", test::plane_scene(800));
  EXPECT_EQ(cv::countNonZero(result.reason), 120);
  EXPECT_EQ(cv::countNonZero(result.reason.col(40) == static_cast<int>(Reason::unknown)), 120);
  const Result root = run("expression: \"sqrt(u - 80)\"", test::plane_scene(800));
  EXPECT_EQ(cv::countNonZero(root.reason), 80 * 120);
}

TEST(Formula, InvalidatesWhereItIsPositive) {
  const Result result = run("stage: signal_mask, on: invalid, expression: \"u - 99.5\"", test::plane_scene(800));
  EXPECT_EQ(cv::countNonZero(result.reason), 60 * 120);
  EXPECT_EQ(cv::countNonZero(result.reason.colRange(100, 160) == static_cast<int>(Reason::unknown)), 60 * 120);
}

TEST(Formula, TimeIsInfiniteWithoutPowerOn) {
  const char* drift = "expression: \"5*exp(-t/tau)\", parameters: {tau: {value: 0.3, unit: s}}";
  EXPECT_NEAR(run(drift, test::plane_scene(800)).depth.at<float>(5, 5), 800 + 5 * std::exp(-1), 1e-3);
  EXPECT_NEAR(run(drift, test::plane_scene(800), false).depth.at<float>(5, 5), 800, 1e-3);
}

TEST(Formula, WhatCannotWorkIsRefusedWithFileAndLine) {
  const std::pair<const char*, const char*> cases[] = {
      {"expression: \"a*(r2\", parameters: {a: 1}", "is not an expression"},
      {"expression: \"2 * * z\"", "is not an expression"},
      {"expression: \"thta*2\"", "did you mean theta"},
      {"expression: \"nosuch(z)\"", "expression"},
      {"expression: \"\"", "expression"},
      {"expression: \"1/0\"", "everywhere"},
      {"expression: \"log(-1)\"", "everywhere"},
      {"expression: \"z\", parameters: {z: 1}", "name of a channel"},
      {"stage: spatial, on: sigma, expression: \"1\"", "stage: amplitude"},
      {"on: nothing, expression: \"1\"", "choices"}};
  for (const auto& [formula, words] : cases) {
    const std::string text = refusal(formula);
    EXPECT_NE(text.find(words), std::string::npos) << formula << "\n" << text;
    EXPECT_NE(text.find("own.yaml:4"), std::string::npos) << formula << "\n" << text;
  }
}

TEST(Formula, DisparityNeedsTheBaseline) {
  CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  context.projector_xyz_mm.reset();
  EXPECT_THROW(SensorRun(model_with("expression: \"d\""), context), Error);
  SensorRun fine(model_with("expression: \"z\""), context);
}

TEST(Formula, ReadsOnlyWhatItUses) {
  const auto reads = [](const char* expression) {
    return SensorRun::needed_channels(model_with(std::string("expression: \"") + expression + "\""), false);
  };
  EXPECT_EQ(reads("z*x"), static_cast<ChannelSet>(Channel::depth));
  EXPECT_EQ(reads("I + theta"), Channel::depth | Channel::ir | Channel::cos_incidence);
  EXPECT_EQ(reads("e - c"), Channel::depth | Channel::edge_distance | Channel::crease_distance);
}

}  // namespace
}  // namespace binrig
