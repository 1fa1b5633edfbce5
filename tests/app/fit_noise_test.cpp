// binrig fit-noise and calibrate, as a user runs them, on planes with a known noise.
#include <cmath>
#include <fstream>
#include <map>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "app/plane_simulation.h"
#include "core/recording_writer.h"
#include "sim/effect.h"
#include "tests/support/program.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using nlohmann::json;
using test::read_json;
using test::run_binrig;

// A set of planes seen by a sensor whose model is known: three distances to fit on, one held out.
void write_planes(const std::string& folder, const std::string& model_text, int frames, double depth_scale_mm = 0.02) {
  const SensorModel model = parse_sensor_model(model_text, "test", effect_catalogue());
  SetInfo info;
  info.sensor.name = "test sensor";
  info.sensor.projector_xyz_mm = Vector3(80, 0, 0);
  info.sensor.range_mm = {600, 1000};
  RecordingWriter writer(folder, info);
  const auto record = [&](const std::string& split, int id, double distance, std::uint64_t seed) {
    PlaneSimulation plane;
    plane.camera = camera_from_field_of_view(200, 150, 0.5);
    plane.normal = Vector3(0.1, 0, -std::sqrt(0.99));
    plane.offset_mm = plane.normal.z() * distance;
    plane.projector_xyz_mm = info.sensor.projector_xyz_mm;
    plane.reference_distance_mm = 800;
    plane.depth_scale_mm = depth_scale_mm;
    plane.frames = frames;
    plane.seed = seed;
    plane.capture = split + std::to_string(id);
    writer.begin_capture({split, id, "plane", TargetKind::plane, frames, false});
    simulate_plane(model, plane)([&](const Frame& frame, int number) {
      Frame stamped = frame;
      stamped.sequence = number;
      stamped.time_s = 0.1 * number;
      writer.write(stamped);
    });
    writer.finish_capture();
  };
  record("train", 1, 700, 1);
  record("train", 2, 800, 2);
  record("train", 3, 900, 3);
  record("test", 1, 760, 4);
}

const char* const known_noise =
    "name: truth\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
    "  - spectral_noise: {sigma: 0.3, correlation_length: 0.9, white_share: 0.2}\n";
const char* start =
    "name: start\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
    "  - spectral_noise: {sigma: 0.6, correlation_length: 2.5, white_share: 0.5}\n"
    "  - smoothing: {sigma: 0}\n";

class FitNoiseVerb : public testing::Test {
 protected:
  void SetUp() override { std::ofstream(folder / "start.yaml") << start; }
  /// What `binrig calibrate --json` says of folder/set; the model is written to folder/calibrated.yaml.
  json calibrated(const std::string& model) {
    const test::Run run = run_binrig("calibrate --quiet --json --measured " + (folder / "set") + " --model " + model +
                                     " --out " + (folder / "calibrated.yaml"));
    EXPECT_EQ(run.status, 0) << run.output;
    return json::parse(run.output);
  }
  test::ScratchFolder folder;
};

TEST_F(FitNoiseVerb, FindsTheNoiseAndItHoldsOnAHeldOutCapture) {
  write_planes(folder / "set", known_noise, 4);
  const test::Run run =
      run_binrig("fit-noise --quiet --measured " + (folder / "set") + " --model " + (folder / "start.yaml") +
                 " --out " + (folder / "out/fitted.yaml") + " --report " + (folder / "report"));
  ASSERT_EQ(run.status, 0) << run.output;
  const json found = read_json(folder / "report/report.json");
  EXPECT_NEAR(found["fit"]["sigma_mm"], 0.3, 0.01) << run.output;
  const json& judged = found["judgements"].at(0);
  EXPECT_EQ(judged["capture"], "test/1");
  EXPECT_TRUE(judged["passed"]) << run.output;
  EXPECT_FALSE(judged["in_sample"]);
  EXPECT_TRUE(judged["strawman"]["fails"]);
  const SensorModel fitted = read_sensor_model(folder / "out/fitted.yaml", effect_catalogue());
  const EffectInstance* noise = fitted.find("spectral_noise");
  ASSERT_NE(noise, nullptr);
  EXPECT_NEAR(noise->value("sigma"), 0.3, 0.01);
  EXPECT_TRUE(noise->values.at("sigma").ci95.has_value());
  EXPECT_EQ(noise->options.at("spectrum"), "fitted.spectrum.json");
  std::ifstream page(folder / "report/report.html");
  EXPECT_TRUE(page.good());
}

TEST_F(FitNoiseVerb, TheDensityMakesUpForAFilterThatActsAfterTheNoise) {
  write_planes(folder / "set", known_noise, 4);
  std::ofstream(folder / "filter.yaml")
      << "name: filter\neffects:\n  - spectral_noise: {sigma: 0.6}\n  - smoothing: {sigma: 0.5}\n";
  const test::Run run = run_binrig("fit-noise --quiet --json --measured " + (folder / "set") + " --model " +
                                   (folder / "filter.yaml") + " --out " + (folder / "fitted.yaml"));
  ASSERT_EQ(run.status, 0) << run.output;
  const json found = json::parse(run.output);
  EXPECT_GT(found["model_sigma_mm"], 0.33);
  EXPECT_TRUE(found["judgements"].at(0)["passed"]) << found["judgements"].at(0).dump(1);
}

TEST_F(FitNoiseVerb, CompareAgreesWithTheModelThatWasWrittenThoughAFilterFollowsTheNoise) {
  const std::string root = BINRIG_SOURCE_DIR, set = root + "/fixtures/recorded/plane-source";
  const test::Run fit = run_binrig("fit-noise --quiet --measured " + set + " --model " + root +
                                   "/models/thesis-five.yaml --out " + (folder / "fitted.yaml"));
  ASSERT_EQ(fit.status, 0) << fit.output;
  const test::Run run = run_binrig("compare --quiet --json --measured " + set + " --model " + (folder / "fitted.yaml") +
                                   " --out " + (folder / "report"));
  ASSERT_EQ(run.status, 0) << run.output;
  // Bands of 2 % a ring are narrower than what one simulation's chance, taken into the model, would add.
  const json found = json::parse(run.output)["fidelity"];
  EXPECT_EQ(found["verdict"], "agrees") << found["headline"] << found["reasons"];
}

TEST_F(FitNoiseVerb, OneFrameOnlyIsSaidToBeAnUpperBound) {
  write_planes(folder / "set", known_noise, 1);
  const test::Run run = run_binrig("fit-noise --quiet --measured " + (folder / "set") + " --model " +
                                   (folder / "start.yaml") + " --out " + (folder / "fitted.yaml"));
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_NE(run.output.find("upper bound"), std::string::npos);
  const test::Run asked = run_binrig("fit-noise --quiet --noise temporal --measured " + (folder / "set") + " --model " +
                                     (folder / "start.yaml") + " --out " + (folder / "fitted.yaml"));
  EXPECT_EQ(asked.status, 2);
  EXPECT_NE(asked.output.find("more than one frame"), std::string::npos) << asked.output;
}

TEST_F(FitNoiseVerb, BadInputIsStatusTwoWithOneClearError) {
  const auto fails = [&](const std::string& arguments, const std::string& words) {
    const test::Run run = run_binrig("fit-noise --quiet --out " + (folder / "o.yaml") + " " + arguments);
    EXPECT_EQ(run.status, 2) << arguments;
    EXPECT_NE(run.output.find(words), std::string::npos) << run.output;
  };
  fails("--measured " + (folder / "nowhere") + " --model " + (folder / "start.yaml"), "nowhere");
  write_planes(folder / "set", known_noise, 1);
  fails("--measured " + (folder / "set") + " --capture train/9 --model " + (folder / "start.yaml"), "train/9");
  fails("--measured " + (folder / "set") + " --model " + (folder / "absent.yaml"), "absent.yaml");
  std::ofstream(folder / "typo.yaml") << "name: typo\neffects:\n  - spectral_noise: {sigmma: 0.6}\n";
  fails("--measured " + (folder / "set") + " --model " + (folder / "typo.yaml"), "sigmma");
  EXPECT_FALSE(std::ifstream(folder / "o.yaml").good());
}

// By "instance.parameter".
std::map<std::string, json> entries(const json& list) {
  std::map<std::string, json> result;
  for (const auto& p : list) result[p["instance"].get<std::string>() + "." + p["parameter"].get<std::string>()] = p;
  return result;
}

TEST_F(FitNoiseVerb, CalibrateFindsParametersAndNamesTheOthers) {
  write_planes(folder / "set",
               "name: truth\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
               "  - spectral_noise: {sigma: 0.3, correlation_length: 0.9, white_share: 0.2}\n"
               "  - depth_units: {step: 0.1}\n",
               4);
  std::ofstream(folder / "ordered.yaml")
      << "name: start\nprojector: recording\neffects:\n"
         "  - depth_offset: {offset: 0}\n  - spectral_noise: {sigma: 0.6, correlation_length: 2.5, white_share: 0.5}\n"
         "  - random_dropout: {rate: 0.001}\n  - depth_units: {step: 0.7}\n";
  const json found = calibrated(folder / "ordered.yaml");
  auto values = entries(found["parameters"]);
  EXPECT_NEAR(values["spectral_noise.sigma"]["value"], 0.3, 0.01);
  EXPECT_NEAR(values["spectral_noise.correlation_length"]["value"], 0.9, 0.05);
  EXPECT_NEAR(values["spectral_noise.white_share"]["value"], 0.2, 0.04);
  // The spectrum's rings are known to 2 %: it bends over a quarter of a pixel, and is straight over what they leave.
  for (const auto& [name, value] : {std::pair{"correlation_length", 0.9}, std::pair{"white_share", 0.2}}) {
    const json interval = values[std::string("spectral_noise.") + name]["ci95"];
    EXPECT_LE(interval.at(0), value) << found;
    EXPECT_GE(interval.at(1), value) << found;
    EXPECT_LT(interval.at(1).get<double>() - interval.at(0).get<double>(), 0.2) << found;
  }
  EXPECT_NEAR(values["depth_units.step"]["value"], 0.1, 1e-9);
  EXPECT_TRUE(entries(found["not_determined"]).contains("depth_offset.offset")) << "there is no pose in this set";
  // Not one pixel of the recording dropped out.
  ASSERT_TRUE(values.contains("random_dropout.rate")) << found;
  EXPECT_EQ(values["random_dropout.rate"]["ci95"].at(0), 0) << found;
  EXPECT_NEAR(read_sensor_model(folder / "calibrated.yaml", effect_catalogue()).find("depth_units")->value("step"), 0.1,
              1e-9);
}

TEST_F(FitNoiseVerb, CalibrateFitsNoiseAndTheBlurBehindItTogether) {
  write_planes(folder / "set",
               "name: truth\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
               "  - spectral_noise: {sigma: 0.5, correlation_length: 0.6, white_share: 0.5}\n"
               "  - bilateral_blur: {sigma_px: 0.8}\n",
               8);
  std::ofstream(folder / "blurred.yaml")
      << "name: start\nprojector: recording\neffects:\n  - projector_shadow: {bias: 1}\n"
         "  - spectral_noise: {sigma: 0.25, correlation_length: 1.6, white_share: 0.1}\n"
         "  - bilateral_blur: {sigma_px: 0.5}\n";
  const json answer = calibrated(folder / "blurred.yaml");
  auto found = entries(answer.at("parameters"));
  // Noise and the blur behind it trade off: the interval's half width here is 0.06, and it must hold the truth.
  EXPECT_NEAR(found["spectral_noise.sigma"]["value"], 0.5, 0.08) << answer;
  EXPECT_LE(found["spectral_noise.sigma"]["ci95"].at(0), 0.5) << answer;
  EXPECT_GE(found["spectral_noise.sigma"]["ci95"].at(1), 0.5) << answer;
  EXPECT_NEAR(found["bilateral_blur.sigma_px"]["value"], 0.8, 0.1) << answer;
  EXPECT_GT(found["bilateral_blur.sigma_px"]["ci95"].at(0), 0.5) << answer;
  EXPECT_TRUE(entries(answer.at("not_determined")).contains("projector_shadow.bias"));
}

TEST_F(FitNoiseVerb, CalibrateSeesThatNoBlurIsBehindTheNoiseAndCompareAgrees) {
  const std::string root = BINRIG_SOURCE_DIR, set = root + "/fixtures/recorded/plane-source";
  const test::Run run = run_binrig("calibrate --quiet --json --measured " + set + " --model " + root +
                                   "/models/thesis-five.yaml --out " + (folder / "calibrated.yaml"));
  ASSERT_EQ(run.status, 0) << run.output;
  auto found = entries(json::parse(run.output)["parameters"]);
  // The fixture's sensor: no blur, though the model has one of 0.6 px.
  const std::map<std::string, double> truth{{"spectral_noise.sigma", 0.25},
                                            {"spectral_noise.correlation_length", 1.4},
                                            {"spectral_noise.white_share", 0.15},
                                            {"bilateral_blur.sigma_px", 0}};
  for (const auto& [name, value] : truth) {
    EXPECT_LE(found[name]["ci95"].at(0), value) << run.output;
    EXPECT_GE(found[name]["ci95"].at(1), value) << run.output;
  }
  EXPECT_LT(found["bilateral_blur.sigma_px"]["ci95"].at(1), 0.5);
  const test::Run compared = run_binrig("compare --quiet --json --seed 2 --measured " + set + " --model " +
                                        (folder / "calibrated.yaml") + " --out " + (folder / "report"));
  ASSERT_EQ(compared.status, 0) << compared.output;
  const json fidelity = json::parse(compared.output)["fidelity"];
  // Of fifteen rings some may lie outside a band of 95 %: that is called undecided.
  EXPECT_NE(fidelity["verdict"], "differs") << fidelity["reasons"];
}

TEST_F(FitNoiseVerb, CalibrateRefusesNamesThatTheModelDoesNotHaveAndLeavesAloneWhatIsFixed) {
  write_planes(folder / "set", known_noise, 2);
  const std::string command = "calibrate --quiet --json --measured " + (folder / "set") + " --model " +
                              (folder / "start.yaml") + " --out " + (folder / "calibrated.yaml");
  const test::Run refused = run_binrig(command + " --fix spectral_noise.sigmma");
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(refused.output.find("sigmma"), std::string::npos) << refused.output;
  EXPECT_FALSE(std::ifstream(folder / "calibrated.yaml").good());
  const test::Run run = run_binrig(command + " --only spectral_noise --fix spectral_noise.white_share");
  ASSERT_EQ(run.status, 0) << run.output;
  const json answer = json::parse(run.output);
  EXPECT_EQ(answer["parameters"].size() + answer["not_determined"].size(), 2) << run.output;
  EXPECT_EQ(
      read_sensor_model(folder / "calibrated.yaml", effect_catalogue()).find("spectral_noise")->value("white_share"),
      0.5);
}

TEST_F(FitNoiseVerb, AnIntervalHoldsItsEstimateWhereStorageIsCoarse) {
  // Steps of 1 mm against noise of 0.6: rounding is a fifth of the measured variance.
  write_planes(folder / "set",
               "name: truth\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
               "  - spectral_noise: {sigma: 0.6, correlation_length: 0.9, white_share: 0.2}\n",
               4, 1.0);
  const json answer = calibrated(folder / "start.yaml");
  ASSERT_FALSE(answer.at("parameters").empty());
  for (const auto& p : answer.at("parameters")) {
    EXPECT_LE(p["ci95"].at(0), p["value"]) << p;
    EXPECT_GE(p["ci95"].at(1), p["value"]) << p;
  }
}

}  // namespace
}  // namespace binrig
