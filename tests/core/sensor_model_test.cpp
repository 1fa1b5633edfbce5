#include <gtest/gtest.h>

#include "core/error.h"
#include "core/sensor_model.h"

namespace binrig {
namespace {

// A catalogue of its own, so that these tests do not depend on what effects there are.
EffectDeclaration declaration(const std::string& name, Stage stage) {
  EffectDeclaration d;
  d.name = name;
  d.stage = stage;
  d.amplitude = "amplitude";
  ParameterSpec amplitude;
  amplitude.name = "amplitude";
  amplitude.unit = "mm";
  amplitude.lower = -2;
  amplitude.upper = 2;
  amplitude.typical_low = 0.1;
  amplitude.typical_high = 1.6;
  amplitude.neutral = 0;
  amplitude.initial = 0.1;
  d.parameters = {amplitude};
  return d;
}

const EffectCatalogue& catalogue() {
  static const EffectDeclaration bow = declaration("bow", Stage::geometry), grain = declaration("grain", Stage::noise),
                                 window = [] {
                                   EffectDeclaration d = declaration("window", Stage::matching);
                                   d.parameters[0].kind = ParameterKind::integer;
                                   d.options = {{"shape", "of the window", "box", {"box", "disc"}, false}};
                                   return d;
                                 }(),
                                 formula = [] {
                                   EffectDeclaration d;
                                   d.name = "formula";
                                   d.user_defined = true;
                                   d.options = {{"on", "what it changes", "depth", {"depth", "sigma"}, false},
                                                {"expression", "the law", "0", {}, false}};
                                   return d;
                                 }();
  static const EffectCatalogue table({&grain, &bow, &window, &formula});
  return table;
}

std::string error_of(const std::string& yaml) {
  try {
    parse_sensor_model(yaml, "m.yaml", catalogue());
  } catch (const Error& problem) {
    return problem.what();
  }
  ADD_FAILURE() << "accepted:\n" << yaml;
  return "";
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST(SensorModel, WhatIsWrittenReadsBackTheSame) {
  const std::string yaml = R"(
name: everything
description: "words, with: punctuation"
camera: {width: 640, height: 480, fx: 600.123456789, cx: 320.5, distortion: [0.1, -0.2]}
projector: {x: 100, y: -1.5, z: 0}
reference_distance: 800
depth_scale: 0.02
frame_rate_hz: 3
range_mm: [700, 900]
unit_seed: 12345
effects:
  - bow: {amplitude: 0.333333333333333}
  - bow: {id: second_bow, provenance: "added because", amplitude: {value: -1.5, ci95: [-1.6, -1.4], provenance: fitted}}
  - formula: {id: law, stage: matching, on: sigma, expression: "1 + a*r2", parameters: {a: {value: 0.2, unit: mm, bounds: [0, 3]}}}
  - window: {amplitude: 2, shape: disc}
  - grain: {}
)";
  const SensorModel a = parse_sensor_model(yaml, "m.yaml", catalogue());
  const std::string text = sensor_model_yaml(a, catalogue());
  const SensorModel b = parse_sensor_model(text, "m.yaml", catalogue());
  EXPECT_EQ(text, sensor_model_yaml(b, catalogue()));
  EXPECT_EQ(a.camera, b.camera);
  EXPECT_EQ(b.camera.fy, 600.123456789);  // square pixels where only fx is given
  EXPECT_EQ(b.camera.cy, 239.5);
  EXPECT_EQ(b.projector_xyz_mm, Vector3(100, -1.5, 0));
  EXPECT_EQ(b.unit_seed, 12345u);
  ASSERT_EQ(b.effects.size(), 5u);
  EXPECT_EQ(b.find("bow")->value("amplitude"), 0.333333333333333);
  EXPECT_EQ((*b.find("second_bow")->values.at("amplitude").ci95)[0], -1.6);
  EXPECT_EQ(b.find("second_bow")->provenance, "added because");
  EXPECT_EQ(b.find("law")->declaration(catalogue()).stage, Stage::matching);
  EXPECT_EQ(b.find("law")->declaration(catalogue()).parameter("a")->upper, 3);
  EXPECT_EQ(b.find("window")->options.at("shape"), "disc");
  EXPECT_EQ(b.find("grain")->value("amplitude"), 0.1);  // absent: the initial value
}

TEST(SensorModel, EveryViolationIsListedAtOnceWithItsLine) {
  const std::string text = error_of(R"(name: bad
camera: {width: 640, height: 480}
projector: nowhere
frame_rate_hz: fast
effects:
  - bow: {amplitude: 5, amplitud: 1}
  - widnow: {}
  - window: {amplitude: 1.5, shape: star}
)");
  for (const char* part : {"m.yaml:2", "fx", "m.yaml:3", "nowhere", "m.yaml:4", "fast", "m.yaml:6",
                           "bow.amplitude = 5 mm is out of bounds (accepted: -2 .. 2 mm)", "did you mean amplitude?",
                           "m.yaml:7", "did you mean window?", "whole number", "star", "box, disc"}) {
    EXPECT_TRUE(contains(text, part)) << part << " is not in:\n" << text;
  }
}

TEST(SensorModel, OrderAgainstTheStagesIsRefusedWithTheReason) {
  const std::string text = error_of("effects:\n  - grain: {}\n  - bow: {}\n");
  EXPECT_TRUE(contains(text, "bow acts in stage geometry and must stand before grain of stage noise")) << text;
}

TEST(SensorModel, TwoEffectsOfOneIdAreRefused) {
  EXPECT_TRUE(contains(error_of("effects:\n  - bow: {}\n  - bow: {}\n"), "id of two effects"));
}

TEST(SensorModel, SyntaxErrorsHaveALine) { EXPECT_TRUE(contains(error_of("name: [\n"), "m.yaml:")); }

TEST(SensorModel, NumbersThatAreNoneAreRefused) {
  EXPECT_TRUE(contains(error_of("effects:\n  - bow: {amplitude: .nan}\n"), "bow.amplitude"));
  EXPECT_TRUE(contains(error_of("effects:\n  - bow: {amplitude: .inf}\n"), "bow.amplitude"));
}

TEST(SensorModel, AnAddedEffectTakesItsPlaceAmongTheStages) {
  SensorModel model = parse_sensor_model("effects:\n  - bow: {}\n  - grain: {}\n", "m.yaml", catalogue());
  EXPECT_EQ(add_effect(model, catalogue(), "window", {{"amplitude", 2}}).id, "window");
  EXPECT_EQ(add_effect(model, catalogue(), "bow").id, "bow_2");
  std::vector<std::string> ids;
  for (const EffectInstance& instance : model.effects) ids.push_back(instance.id);
  EXPECT_EQ(ids, (std::vector<std::string>{"bow", "bow_2", "window", "grain"}));
  EffectInstance again = *model.find("window");
  again.values["amplitude"].value = 1;
  EXPECT_EQ(add_effect(model, catalogue(), again).id, "window_2");
  EXPECT_EQ(model.effects[3].id, "window_2");
  EXPECT_EQ(model.effects[3].value("amplitude"), 1);
  EXPECT_THROW(add_effect(model, catalogue(), "window", {{"amplitude", 7}}), Error);
  EXPECT_THROW(add_effect(model, catalogue(), "nothing"), Error);
}

// The 15, 50 and 85 % points of 0.1 .. 1.6 on a log scale: 0.1 * 16^share.
TEST(SensorModel, StrengthsAreQuantilesOfTheTypicalRange) {
  EffectDeclaration d = declaration("bow", Stage::geometry);
  EXPECT_NEAR(strength_value(d, Strength::weak), 0.1 * std::pow(16, 0.15), 1e-12);
  EXPECT_NEAR(strength_value(d, Strength::medium), 0.4, 1e-12);
  EXPECT_NEAR(strength_value(d, Strength::strong), 0.1 * std::pow(16, 0.85), 1e-12);
  d.stronger_is_larger = false;
  EXPECT_NEAR(strength_value(d, Strength::strong), 0.1 * std::pow(16, 0.15), 1e-12);
}

}  // namespace
}  // namespace binrig
