// binrig compare, as a user runs it, on planes with a known noise.
#include <cmath>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
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
using testing::HasSubstr;

constexpr const char* truth =
    "name: truth\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
    "  - spectral_noise: {sigma: 0.3, correlation_length: 0.9, white_share: 0.2}\n";
constexpr const char* strawman =
    "name: strawman\ncamera: recording\nprojector: recording\ndepth_scale: recording\neffects:\n"
    "  - spectral_noise: {sigma: 0.3, correlation_length: 0.9, white_share: 1}\n";

class CompareVerb : public testing::Test {
 protected:
  void SetUp() override {
    std::ofstream(folder_ / "truth.yaml") << truth;
    std::ofstream(folder_ / "strawman.yaml") << strawman;
    const SensorModel model = parse_sensor_model(truth, "test", effect_catalogue());
    SetInfo info;
    info.sensor.name = "test sensor";
    info.sensor.projector_xyz_mm = Vector3(80, 0, 0);
    info.sensor.range_mm = {600, 1000};
    RecordingWriter writer(folder_ / "set", info);
    for (const auto& [split, distance] : {std::pair{"train", 700.0}, {"test", 760.0}}) {
      PlaneSimulation plane;
      plane.camera = camera_from_field_of_view(240, 180, 0.5);
      plane.normal = Vector3(0.1, 0, -std::sqrt(0.99));
      plane.offset_mm = plane.normal.z() * distance;
      plane.projector_xyz_mm = info.sensor.projector_xyz_mm;
      plane.reference_distance_mm = 800;
      plane.depth_scale_mm = 0.02;
      plane.frames = 6;
      plane.seed = 11;
      plane.capture = split;
      writer.begin_capture({split, 1, "plane", TargetKind::plane, 6, false});
      simulate_plane(model, plane)([&](const Frame& frame, int number) {
        Frame stamped = frame;
        stamped.sequence = number;
        writer.write(stamped);
      });
      writer.finish_capture();
    }
  }
  std::string base() { return "compare --quiet --measured " + (folder_ / "set") + " --out " + (folder_ / "out") + " "; }
  json report() { return read_json(folder_ / "out/report.json"); }
  static json aspect(const json& report, const std::string& id) {
    for (const auto& a : report["fidelity"]["aspects"]) {
      if (a["aspect"] == id) return a;
    }
    return nullptr;
  }
  test::ScratchFolder folder_;
};

TEST_F(CompareVerb, TheRightModelAgrees) {
  const auto run = run_binrig(base() + "--seed 3 --model " + (folder_ / "truth.yaml"));
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/report.html"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/test_1_spectrum.png"));
  const json r = report();
  for (const char* id : {"noise_level", "spectrum", "correlation_length", "fill_rate", "quantisation"}) {
    EXPECT_EQ(aspect(r, id)["agreement"], "agrees") << aspect(r, id).dump();
  }
  EXPECT_TRUE(r["fidelity"]["captures"][0]["measured"]["white"]["rejected"]);
}

TEST_F(CompareVerb, WhiteNoiseOfTheSameSizeBreaksALimitAndGivesStatusOne) {
  std::ofstream(folder_ / "limits.yaml") << "noise_level: 0.1\nspectrum_inside: 0.85\n";
  const auto run =
      run_binrig(base() + "--model " + (folder_ / "strawman.yaml") + " --require " + (folder_ / "limits.yaml"));
  EXPECT_EQ(run.status, 1) << run.output;
  EXPECT_THAT(run.output, HasSubstr("spectrum_inside"));
  EXPECT_THAT(run.output, testing::Not(HasSubstr("noise_level is")));
  EXPECT_EQ(aspect(report(), "spectrum")["agreement"], "differs");
  EXPECT_EQ(aspect(report(), "noise_level")["agreement"], "agrees");
}

TEST_F(CompareVerb, ASetAgreesWithItself) {
  const auto run = run_binrig(base() + "--simulated " + (folder_ / "set"));
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_EQ(report()["fidelity"]["verdict"], "agrees");
}

TEST_F(CompareVerb, TheSameSeedGivesTheSameReport) {
  ASSERT_EQ(run_binrig(base() + "--seed 3 --model " + (folder_ / "truth.yaml")).status, 0);
  const json first = report();
  ASSERT_EQ(run_binrig(base() + "--seed 3 --jobs 1 --model " + (folder_ / "truth.yaml")).status, 0);
  EXPECT_EQ(first, report());
}

TEST_F(CompareVerb, BadInputIsOneClearErrorAndNothingIsWritten) {
  const std::string model = "--model " + (folder_ / "truth.yaml");
  const auto refused = [&](const std::string& arguments, const std::string& words) {
    const auto run = run_binrig(base() + arguments);
    EXPECT_EQ(run.status, 2) << arguments << "\n" << run.output;
    EXPECT_THAT(run.output, HasSubstr(words));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out/report.html"));
  };
  refused("", "--model");
  refused(model + " --capture train/9", "train/1");
  std::ofstream(folder_ / "typo.yaml") << "noise_lewel: 0.1\n";
  refused(model + " --require " + (folder_ / "typo.yaml"), "noise_level");
  std::ofstream(folder_ / "words.yaml") << "noise_level: much\n";
  refused(model + " --require " + (folder_ / "words.yaml"), "words.yaml");
  std::ofstream(folder_ / "infinite.yaml")
      << "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
         "depth_scale: recording\neffects:\n  - formula: {expression: 0.1 / (x - x)}\n";
  refused("--model " + (folder_ / "infinite.yaml"), "as simulated: only 0 px");
  std::filesystem::resize_file(folder_ / "set/test/000001/depth/000003.png", 2000);
  refused(model, "000003.png");
}

}  // namespace
}  // namespace binrig
