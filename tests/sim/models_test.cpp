// Every model that is shipped loads and makes a frame; the fitted cameras say of each number where it comes from.
#include <filesystem>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

std::vector<std::string> shipped() {
  std::vector<std::string> files;
  for (const auto& item : std::filesystem::directory_iterator(std::string(BINRIG_SOURCE_DIR) + "/models"))
    if (item.path().extension() == ".yaml") files.push_back(item.path().string());
  return files;
}

TEST(Models, EveryOneLoadsAndMakesAFrameInWhichMostThingsHaveDepth) {
  int rendered = 0;
  for (const auto& file : shipped()) {
    const SensorModel model = read_sensor_model(file, effect_catalogue());
    if (model.dot_pattern) continue;  // tests/sim/dot_pattern_test.cpp
    const test::AnalyticScene scene = test::mixed_scene();
    CaptureContext context = test::analytic_context(scene, test::small_camera());
    const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
    const Frame frame = SensorRun(model, context).frame(*channels, {});
    frame.check(file);
    EXPECT_GT(cv::countNonZero(frame.depth_mm), 0.5 * cv::countNonZero(channels->depth_mm)) << file;
    cv::Mat error;
    cv::absdiff(frame.depth_mm, channels->depth_mm, error);
    EXPECT_GT(cv::norm(error, cv::NORM_INF, frame.depth_mm > 0), 0.05) << file << " is no sensor";
    ++rendered;
  }
  EXPECT_GE(rendered, 3);
}

TEST(Models, FittedCamerasSayWhereEachNumberComesFrom) {
  for (const char* name : {"kinect-v1", "realsense-d415", "sr300", "truedepth"}) {
    const std::string file = std::string(BINRIG_SOURCE_DIR) + "/models/" + name + ".yaml";
    const SensorModel model = read_sensor_model(file, effect_catalogue());
    int fitted = 0;
    for (const auto& effect : model.effects)
      for (const auto& [parameter, value] : effect.values) {
        const std::string where = std::string(name) + ": " + effect.id + "." + parameter + ": " + value.provenance;
        const bool is_fitted = value.provenance.starts_with("fitted: ");
        EXPECT_TRUE(is_fitted || value.provenance.starts_with("published: ") || value.provenance.starts_with("assumed"))
            << where;
        EXPECT_EQ(is_fitted, value.ci95.has_value()) << where;
        fitted += is_fitted;
      }
    EXPECT_GE(fitted, 2) << name;  // single frames (Kinect v1) determine no more
  }
}

}  // namespace
}  // namespace binrig
