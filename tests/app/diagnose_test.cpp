// binrig diagnose and improve, as a user runs them: on recordings and models that no effect can explain, a clear
// sentence each, and never the name of an effect; on an instrument that no effect made, the imperfection it was given.
#include <filesystem>
#include <fstream>
#include <functional>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/support/program.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::read_json;
using test::run_binrig;
using testing::HasSubstr;

class DiagnoseBadInput : public testing::Test {
 protected:
  void SetUp() override {
    setenv("BINRIG_CACHE", (folder_ / "cache").c_str(), 1);
    fs::copy(fs::path(BINRIG_SOURCE_DIR) / "fixtures/recorded/campaign-imperfect", set_, fs::copy_options::recursive);
  }

  void TearDown() override { unsetenv("BINRIG_CACHE"); }


  /// Every file of that name in the set, rewritten.
  void edit(const std::string& name, const std::function<void(json&)>& change) const {
    for (const auto& entry : fs::recursive_directory_iterator(set_)) {
      if (entry.path().filename() != name) continue;
      json content = read_json(entry.path());
      change(content);
      std::ofstream(entry.path()) << content.dump();
    }
  }

  fs::path model_with(const std::string& from, const std::string& to) const {
    std::ifstream in(fs::path(BINRIG_SOURCE_DIR) / "models/thesis-five.yaml");
    std::string text((std::istreambuf_iterator<char>(in)), {});
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) text.replace(at, from.size(), to);
    const fs::path path = folder_ / "model.yaml";
    std::ofstream(path) << text;
    return path;
  }

  test::Run diagnose(const fs::path& model = fs::path(BINRIG_SOURCE_DIR) / "models/thesis-five.yaml") const {
    return run_binrig("diagnose --quiet --measured " + set_.string() + " --model " + model.string() + " --out " +
                      (folder_ / "out").string());
  }

  void expect_not_enough_data(const std::string& reason) const {
    const auto run = diagnose();
    EXPECT_EQ(run.status, 0) << run.output;
    EXPECT_THAT(run.output, HasSubstr(reason));
    const json diagnosis = read_json(folder_ / "out/diagnosis.json");
    EXPECT_EQ(diagnosis["verdict"], "not_enough_data");
    EXPECT_TRUE(diagnosis["candidates"].empty());
  }

  void expect_refused(const test::Run& run, const std::string& reason) const {
    EXPECT_EQ(run.status, 2);
    EXPECT_THAT(run.output, HasSubstr(reason));
    EXPECT_FALSE(fs::exists(folder_ / "out/diagnosis.json"));
  }

  test::ScratchFolder scratch_;
  const fs::path folder_ = fs::path(scratch_ / ""), set_ = folder_ / "set";
};

TEST_F(DiagnoseBadInput, NeitherPosesNorPlanes) {
  edit("recording.json", [](json& r) {
    for (auto& capture : r["captures"]) capture["target"] = "other";
  });
  std::vector<fs::path> poses;
  for (const auto& entry : fs::recursive_directory_iterator(set_))
    if (entry.path().filename() == "scene_gt.json") poses.push_back(entry.path());
  for (const auto& path : poses) fs::remove(path);
  expect_refused(diagnose(), "no capture has poses");
}

TEST_F(DiagnoseBadInput, OneTargetOnly) {
  edit("recording.json", [](json& r) { r["captures"] = json::array({r["captures"][0]}); });
  for (int id = 2; id <= 11; ++id) fs::remove_all(set_ / "train" / fmt::format("{:06}", id));
  fs::remove_all(set_ / "test");
  expect_not_enough_data("captures in the split \"test\"");
}

TEST_F(DiagnoseBadInput, NearlyEverythingInvalid) {
  for (const auto& entry : fs::recursive_directory_iterator(set_)) {
    if (entry.path().parent_path().filename() != "depth" || entry.path().extension() != ".png") continue;
    cv::Mat depth = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
    for (int row = 0; row < depth.rows; ++row)
      for (int col = 0; col < depth.cols; ++col)
        if ((7 * row + 3 * col) % 12 != 0) depth.at<std::uint16_t>(row, col) = 0;
    cv::imwrite(entry.path().string(), depth);
  }
  expect_not_enough_data("captures with depth");
}

TEST_F(DiagnoseBadInput, DepthInAnotherUnit) {
  edit("scene_camera.json", [](json& frames) {
    for (auto& frame : frames) frame["depth_scale"] = frame["depth_scale"].get<double>() / 1000;
  });
  expect_refused(diagnose(), "metres for millimetres");
}

TEST_F(DiagnoseBadInput, ShadowsOnTheOtherSide) {
  expect_refused(diagnose(model_with("projector: recording", "projector: {x: -100, y: 0, z: 0}")),
                 "the sign of the baseline");
}

TEST_F(DiagnoseBadInput, AnotherCamera) {
  expect_refused(diagnose(model_with("camera: recording", "camera: {width: 640, height: 480, horizontal_fov_deg: 60}")),
                 "another camera than the model's");
}

// The model was improved on the same instrument before it had the imperfection (fixtures/recorded/README.md), and is
// far from exact: what differs between the two recordings is the dome, 0.11 .. 0.13 px in planes (with the locking that
// comes with it; 0.15 were built in).
TEST(ImproveInstrument, TheImperfectionIsTheFirstName) {
  const test::ScratchFolder scratch;
  const fs::path folder = fs::path(scratch / ""), source = BINRIG_SOURCE_DIR;
  setenv("BINRIG_CACHE", (folder / "cache").c_str(), 1);
  const auto run =
      run_binrig("improve --quiet --measured " + (source / "fixtures/recorded/campaign-imperfect").string() +
                 " --model " + (source / "fixtures/recorded/models/clean-improved.yaml").string() +
                 " --max-effects 1 --out " + (folder / "out").string());
  unsetenv("BINRIG_CACHE");
  ASSERT_EQ(run.status, 0) << run.output;
  const json diagnosis = read_json(folder / "out/diagnosis.json");
  ASSERT_EQ(diagnosis["candidates"].size(), 1u) << run.output;
  EXPECT_EQ(diagnosis["candidates"][0]["effect"], "radial_distortion");
  EXPECT_FALSE(diagnosis["candidates"][0]["differs_between_captures"]) << "what else is missing is no contradiction";
  EXPECT_NEAR(diagnosis["candidates"][0]["parameters"]["amplitude"]["value"].get<double>(), 0.12, 0.02);
  const json ladder = read_json(folder / "out/ladder.json");
  const json &before = ladder.front(), &after = ladder.back();
  EXPECT_LT(after["heldout"].get<double>(), 0.6 * before["heldout"].get<double>());
  EXPECT_LT(after["bias_rms_mm"].get<double>(), 0.4 * before["bias_rms_mm"].get<double>());
}

}  // namespace
}  // namespace binrig
