// binrig simulate and binrig apply, as a user runs them.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/recording_set.h"
#include "tests/support/program.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using nlohmann::json;
using test::read_json;
using test::run_binrig;

const char* const box_and_socket = R"(
parts:
  - {part: box, poses: [{translation: [-20, 0, 10]}]}
  - {part: socket, poses: [{translation: [15, 5, 20]}]}
table: {height: 0}
sensors:
  - name: above
    pose: {from: [0, 0, 800], at: [0, 0, 0]}
    camera: {width: 160, height: 120, horizontal_fov_deg: 16}
    projector: [100, 0, 0]
    range: [700, 900]
)";

TEST(SimulateVerb, WritesWhatBopToolsRead) {
  test::ScratchFolder folder;
  std::ofstream(folder / "world.yaml") << box_and_socket;
  const std::string model = std::string(BINRIG_SOURCE_DIR) + "/models/thesis-five.yaml", out = folder / "set";
  const test::Run run = run_binrig("simulate --quiet --world " + (folder / "world.yaml") + " --model " + model +
                                   " --out " + out + " --scenes 2 --frames 2");
  ASSERT_EQ(run.status, 0) << run.output;
  const RecordingSet set = RecordingSet::open(out);
  ASSERT_EQ(set.captures().size(), 2u);
  EXPECT_EQ(set.models().size(), 2u);
  const CaptureReader reader = set.capture("test", 2);
  ASSERT_EQ(reader.size(), 2);
  const Frame frame = reader.frame(1);
  EXPECT_EQ(frame.objects->size(), 2u);
  EXPECT_FALSE(frame.rgb.empty());
  EXPECT_FALSE(frame.ir.empty());
  EXPECT_GT(cv::countNonZero(frame.reason == static_cast<int>(Reason::shadow)), 0);

  const json info = read_json(out + "/test/000002/scene_gt_info.json");
  ASSERT_EQ(info["1"].size(), 2u);
  for (const json& object : info["1"]) {
    EXPECT_LE(object["px_count_visib"], object["px_count_all"]);
    EXPECT_EQ(object["bbox_obj"].size(), 4u);
  }
  EXPECT_TRUE(std::filesystem::exists(out + "/test/000002/mask/000001_000001.png"));
  EXPECT_TRUE(std::filesystem::exists(out + "/test/000002/mask_visib/000001_000001.png"));
  const json models = read_json(out + "/models/models_info.json");
  EXPECT_EQ(models["1"]["symmetries_discrete"].size(), 3u);
  EXPECT_EQ(models["1"]["symmetries_discrete"][0].size(), 16u);
  const json targets = read_json(out + "/test_targets_bop19.json");
  EXPECT_EQ(targets.size(), 8u);  // 2 scenes, 2 frames, 2 objects
}

TEST(ApplyVerb, PutsTheSensorOnPerfectDepth) {
  test::ScratchFolder folder;
  std::ofstream(folder / "world.yaml") << box_and_socket;
  std::ofstream(folder / "perfect.yaml") << "name: perfect\ndepth_scale: 0.02\n";
  ASSERT_EQ(run_binrig("simulate --quiet --no-rgb --world " + (folder / "world.yaml") + " --model " +
                       (folder / "perfect.yaml") + " --out " + (folder / "perfect"))
                .status,
            0);
  const std::string model = std::string(BINRIG_SOURCE_DIR) + "/models/thesis-five.yaml";
  const test::Run run =
      run_binrig("apply --quiet --model " + model + " --in " + (folder / "perfect") + " --out " + (folder / "sensed"));
  ASSERT_EQ(run.status, 0) << run.output;
  const Frame before = RecordingSet::open(folder / "perfect").capture("test/1").frame(0);
  const Frame after = RecordingSet::open(folder / "sensed").capture("test/1").frame(0);
  EXPECT_EQ(before.objects->size(), after.objects->size());
  EXPECT_GT(cv::countNonZero(after.reason == static_cast<int>(Reason::shadow)), 20);
  cv::Mat moved = cv::abs(before.depth_mm - after.depth_mm) > 0.05;
  EXPECT_GT(cv::countNonZero(moved), 160 * 120 / 2);  // noise
  EXPECT_EQ(RecordingSet::open(folder / "sensed").models().size(), 2u);
}

TEST(SimulateVerb, BadInputIsStatusTwoAndClear) {
  test::ScratchFolder folder;
  std::ofstream(folder / "world.yaml") << "parts: [{part: cylnder}]\nsensors: [{pose: {}}]\n";
  const test::Run run = run_binrig("simulate --world " + (folder / "world.yaml") + " --out " + (folder / "out"));
  EXPECT_EQ(run.status, 2);
  EXPECT_NE(run.output.find("did you mean cylinder?"), std::string::npos) << run.output;
  EXPECT_FALSE(std::filesystem::exists(folder / "out"));
}

}  // namespace
}  // namespace binrig
