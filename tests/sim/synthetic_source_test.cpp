#include "sim/synthetic_source.h"

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/recording_set.h"
#include "core/recording_writer.h"
#include "sim/bop_extras.h"
#include "sim/effect.h"

namespace binrig {
namespace {

using namespace std::chrono_literals;

const char* const world_text = R"(
parts:
  - {part: box, surfaces: [{albedo: 0.6}], poses: [{translation: [-20, 0, 10]}]}
  - {part: socket, poses: [{translation: [15, 5, 20]}]}
table: {height: 0}
sensors:
  - name: still
    pose: {from: [0, 0, 800], at: [0, 0, 0]}
    camera: {width: 160, height: 120, horizontal_fov_deg: 16}
    projector: [100, 0, 0]
    range: [700, 900]
  - name: moving
    poses: [{from: [0, 0, 800], at: [0, 0, 0]}, {from: [0, 200, 780], at: [0, 0, 0]}]
    camera: {width: 160, height: 120, horizontal_fov_deg: 16}
)";

SensorModel thesis_five() {
  return read_sensor_model(std::string(BINRIG_SOURCE_DIR) + "/models/thesis-five.yaml", effect_catalogue());
}

std::unique_ptr<FrameSource> source(int sensor, std::uint64_t seed, int scenes, int frames) {
  SyntheticOptions options;
  options.sensor = sensor;
  options.seed = seed;
  options.with_rgb = true;
  return make_synthetic_source("sim:test", fixed_world(parse_world(world_text, "test.yaml")), thesis_five(), options,
                               scenes, frames);
}

TEST(SyntheticSource, DeliversWholeFramesAndEnds) {
  const auto s = source(0, 1, 2, 2);
  s->start();
  for (int i = 0; i < 4; ++i) {
    const auto frame = s->next(1s);
    ASSERT_TRUE(frame);
    frame->check("frame");
    EXPECT_EQ(frame->sequence, i);
    ASSERT_EQ(frame->objects->size(), 2u);
    EXPECT_NEAR((*frame->X_WC * (*frame->objects)[0].X_CO).translation().x(), -20, 1e-9);
    double largest = 0;
    cv::minMaxLoc(frame->ids, nullptr, &largest);
    EXPECT_EQ(largest, 2);  // the table has no id
    EXPECT_FALSE(frame->rgb.empty());
    EXPECT_EQ(frame->ir.type(), CV_16U);
    cv::Mat shadow = frame->reason == static_cast<int>(Reason::shadow);
    EXPECT_GT(cv::countNonZero(shadow), 20);
  }
  EXPECT_FALSE(s->next(1s));
  EXPECT_FALSE(s->next(1s));
}

TEST(SyntheticSource, SameSeedSameBytesAndEverySceneStandsForItself) {
  const auto all = [&](int scenes, std::uint64_t seed) {
    const auto s = source(1, seed, scenes, 1);
    s->start();
    std::vector<Frame> frames;
    while (auto frame = s->next(1s)) frames.push_back(*frame);
    return frames;
  };
  const auto a = all(3, 5), b = all(3, 5), c = all(3, 6);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(difference(a[i], b[i]), "");
    EXPECT_NE(difference(a[i], c[i]), "");
  }
  EXPECT_FALSE(a[0].X_WC->isApprox(*a[1].X_WC));  // the mount moves
  EXPECT_TRUE(a[0].X_WC->isApprox(*a[2].X_WC));
  EXPECT_GT(cv::norm(a[0].depth_mm, a[2].depth_mm, cv::NORM_INF), 0);  // but draws are new
}

TEST(SyntheticSource, ModelsAndWorldsThatDoNotFitAreRefused) {
  const World world = parse_world(world_text, "test.yaml");
  SyntheticOptions options;
  options.sensor = 2;
  EXPECT_THROW(SyntheticCamera(fixed_world(world), thesis_five(), options), Error);
  World blind = world;
  blind.sensors[0].camera.reset();
  try {
    SyntheticCamera(fixed_world(blind), thesis_five());
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("needs a camera"));
  }
}

TEST(ObjectMasks, WholeMasksHoldTheVisibleOnesAndCount) {
  SyntheticCamera camera(fixed_world(parse_world(world_text, "test.yaml")), thesis_five());
  camera.begin_scene(0, 1);
  const Frame frame = camera.frame();
  const ObjectMasks masks =
      object_masks(camera.renderer(), camera.scene(), camera.request(), 2, frame.ids, frame.depth_mm);
  ASSERT_EQ(masks.info.size(), 2u);
  for (int k = 0; k < 2; ++k) {
    const auto& info = masks.info[static_cast<std::size_t>(k)];
    const cv::Mat visible = frame.ids == k + 1;
    EXPECT_EQ(cv::countNonZero(visible & ~masks.whole[static_cast<std::size_t>(k)]), 0);
    EXPECT_EQ(info.pixels_visible, cv::countNonZero(visible));
    EXPECT_GE(info.pixels_all, info.pixels_visible);
    EXPECT_GT(info.visible_share(), 0.5);
    EXPECT_EQ(info.box_visible & info.box_all, info.box_visible);
  }
  EXPECT_LT(masks.info[0].visible_share(), 1);  // the socket stands before the box
}

TEST(BopModels, AreReadBackWithTheirReflectance) {
  const std::string folder = testing::TempDir() + "/bop_models";
  std::filesystem::remove_all(folder);
  const World world = parse_world(world_text, "test.yaml");
  SyntheticCamera camera(fixed_world(world), thesis_five());
  SetInfo info;
  info.sensor = camera.info().sensor;
  {
    RecordingWriter writer(folder, info);
    CaptureInfo capture;
    capture.split = "test";
    capture.id = 1;
    writer.begin_capture(capture);
    camera.begin_scene(0, 1);
    writer.write(camera.frame());
    writer.finish_capture();
  }
  write_bop_models(world, folder);
  const RecordingSet set = RecordingSet::open(folder);
  ASSERT_EQ(set.models().size(), 2u);
  EXPECT_EQ(set.models()[0].albedo, 0.6);
  EXPECT_NEAR(set.models()[0].diameter_mm, std::hypot(std::hypot(50, 30), 20), 1e-3);
  EXPECT_EQ(load_mesh(set.models()[1].mesh_path)->triangles.size(), world.parts[1].model.mesh->triangles.size());
}

}  // namespace
}  // namespace binrig
