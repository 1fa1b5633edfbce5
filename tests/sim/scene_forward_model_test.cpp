#include "sim/scene_forward_model.h"

#include <gtest/gtest.h>

#include <fstream>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/recording_writer.h"
#include "sim/effect.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

constexpr double first_z_mm = 700, speed_mm_s = 30;

// A square of 400 mm that moves away from the camera, 10 frames a second; its mesh and poses are in the set.
std::string moving_square(const test::ScratchFolder& folder, int frames) {
  const std::string path = folder / "set";
  SetInfo info;
  info.sensor.name = "test sensor";
  info.sensor.frame_rate_hz = 10;
  info.sensor.projector_xyz_mm = Vector3(100, 0, 0);
  info.sensor.range_mm = {{600, 1000}};
  RecordingWriter writer(path, info);
  CaptureInfo capture;
  capture.split = "train";
  capture.id = 1;
  writer.begin_capture(capture);
  for (int i = 0; i < frames; ++i) {
    Frame frame;
    frame.camera = camera_from_field_of_view(64, 48, 0.3);
    frame.depth_scale_mm = 0.05;
    frame.depth_mm = cv::Mat(48, 64, CV_32F, cv::Scalar(700));
    frame.reason = cv::Mat::zeros(48, 64, CV_8U);
    ObjectPose pose;
    pose.obj_id = 1;
    pose.X_CO.translation() = Vector3(0, 0, first_z_mm + speed_mm_s * i / 10);
    frame.objects = {pose};
    frame.time_s = 5 + i / 10.0;  // the device's clock does not begin at 0
    writer.write(frame);
  }
  writer.finish_capture();
  std::filesystem::create_directories(path + "/models");
  std::ofstream(path + "/models/obj_000001.ply")
      << "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
         "property list uchar int vertex_indices\nend_header\n-200 -200 0\n200 -200 0\n200 200 0\n-200 200 0\n3 0 2 1\n3 0 3 2\n";
  std::ofstream(path + "/models/models_info.json") << R"({"1": {"diameter": 565.7, "albedo": 0.6, "specular": 0}})";
  return path;
}

float centre(const cv::Mat& depth) { return depth.at<float>(24, 32); }

SensorModel model_of(const std::string& effects) { return parse_sensor_model("name: m\n" + effects, "m", effect_catalogue()); }

TEST(SceneForwardModel, PosesAreInterpolatedBetweenFramesAndContinueBeyondThem) {
  test::ScratchFolder folder;
  const SceneForwardModel forward(RecordingSet::open(moving_square(folder, 4)));
  for (double time_s : {-0.1, 0.0, 0.05, 0.1, 0.25, 0.3, 0.5}) {
    const RenderScene scene = forward.scene_at(0, time_s, Offset{});
    EXPECT_NEAR(scene.objects[0].X_CO.translation().z(), first_z_mm + speed_mm_s * time_s, 1e-9) << time_s;
  }
}

TEST(SceneForwardModel, FramesCarryNominalPosesAndCameraWhateverTheOffset) {
  test::ScratchFolder folder;
  const RecordingSet set = RecordingSet::open(moving_square(folder, 2));
  const SceneForwardModel forward(set);
  const SensorModel model = model_of("depth_scale: 0.02\n");
  SimulationRequest request;
  request.model = &model;
  request.offset.pose << 0, 0, 0, 0, 0, 0.5;
  request.offset.focal_px = 3;
  int count = 0;
  forward.simulate(request, [&](const Frame& frame, int number) {
    const Frame header = set.capture("train/1").header(number);
    EXPECT_EQ(frame.camera.fx, header.camera.fx);
    EXPECT_EQ((*frame.objects)[0].X_CO.matrix(), (*header.objects)[0].X_CO.matrix());
    EXPECT_NEAR(centre(frame.depth_mm), first_z_mm + 3 * number + 0.5, 0.011);  // half a step; but the square stands where the offset says
    ++count;
  });
  EXPECT_EQ(count, 2);
}

TEST(SceneForwardModel, SameSeedSameBytesWhateverTheThreadsAndOtherSeedOtherBytes) {
  test::ScratchFolder folder;
  const SceneForwardModel forward(RecordingSet::open(moving_square(folder, 2)));
  const SensorModel model = model_of("effects:\n  - spectral_noise: {sigma: 0.3}\n");
  const auto frame_of = [&](std::uint64_t seed) {
    SimulationRequest request;
    request.model = &model;
    request.seed = seed;
    cv::Mat last;
    forward.simulate(request, [&](const Frame& frame, int) { last = frame.depth_mm.clone(); });
    return last;
  };
  EXPECT_EQ(cv::norm(frame_of(1), frame_of(1), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(frame_of(1), frame_of(2), cv::NORM_INF), 0);
}

TEST(SceneForwardModel, PerfectChannelsAreSharedAndExtendedWhenMoreIsAsked) {
  test::ScratchFolder folder;
  const SceneForwardModel forward(RecordingSet::open(moving_square(folder, 2)));
  const SensorModel model = model_of("");
  const auto depth = forward.perfect(0, 0, Offset{}, Channel::depth | Channel::depth, model);
  EXPECT_EQ(depth, forward.perfect(0, 0, Offset{}, Channel::depth | Channel::depth, model));
  const auto more = forward.perfect(0, 0, Offset{}, Channel::depth | Channel::normal, model);
  EXPECT_FALSE(more->normal.empty());
  EXPECT_EQ(more, forward.perfect(0, 0, Offset{}, Channel::depth | Channel::depth, model));
}

TEST(SceneForwardModel, AModelWithAnotherCameraIsRefused) {
  test::ScratchFolder folder;
  const SceneForwardModel forward(RecordingSet::open(moving_square(folder, 1)));
  const SensorModel model = model_of("camera: {width: 640, height: 480, fx: 600}\n");
  SimulationRequest request;
  request.model = &model;
  try {
    forward.simulate(request, [](const Frame&, int) {});
    FAIL();
  } catch (const Error& problem) {
    EXPECT_NE(std::string(problem.what()).find("another camera"), std::string::npos);
  }
}

TEST(SceneForwardModel, ASetWithoutPosesOrPlanesCannotBeSimulatedButWithAPlaneItCan) {
  test::ScratchFolder folder;
  const std::string path = moving_square(folder, 2);
  std::filesystem::remove(path + "/train/000001/scene_gt.json");
  const RecordingSet set = RecordingSet::open(path);
  EXPECT_THROW(SceneForwardModel{set}, Error);
  SceneOptions options;
  options.planes["train/1"] = {ScenePlane{}};
  const SceneForwardModel forward(set, options);
  EXPECT_NEAR(centre(forward.perfect(0, 1, Offset{}, Channel::depth | Channel::depth, model_of(""))->depth_mm), 800, 1e-3);
}

}  // namespace
}  // namespace binrig
