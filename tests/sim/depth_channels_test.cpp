#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "sim/part_models.h"
#include "sim/renderer.h"
#include "sim/sensor.h"

namespace binrig {
namespace {

constexpr ChannelSet everything = 0x3ff;  // all but rgb

RenderScene scene_with_parts() {
  RenderScene scene;
  scene.plane = ScenePlane{};
  int i = 0;
  for (const char* name : {"box", "cylinder", "sphere"}) {
    Pose X(Eigen::AngleAxisd(0.4 + i, Vector3(1, 0.5, 0.3).normalized()));
    X.pretranslate(Vector3(-60 + 60 * i, 10 * i, 765));
    scene.objects.push_back({part_model(name).mesh, X, ++i});
  }
  return scene;
}

// The truth is the renderer; depth alone cannot know hidden surfaces, so shadows may differ beside edges.
TEST(ChannelsFromDepth, AgreeWithTheRendererAwayFromEdges) {
  const Camera camera = camera_from_field_of_view(480, 360, 16 * EIGEN_PI / 180);
  for (const Vector3& projector : {Vector3(100, 0, 0), Vector3(-80, 20, 5)}) {
    const auto truth = make_renderer("embree")->render(scene_with_parts(), {camera, projector, 800, everything});
    const auto guess = channels_from_depth(truth->depth_mm, camera, projector, 800, everything);
    EXPECT_EQ(guess->present(), everything);
    const cv::Mat calm = (truth->edge_px > 3.f) & (truth->cos_incidence > 0.3f);
    // Facets: a normal across a ridge is a mean of two.
    cv::Mat d_cos = cv::abs(truth->cos_incidence - guess->cos_incidence) > 0.05;
    EXPECT_LT(cv::countNonZero(d_cos & calm), cv::countNonZero(calm) / 50);
    const cv::Mat shadow = truth->projector_gap_mm > 1.f, found = guess->projector_gap_mm > 1.f;
    const double overlap = cv::countNonZero(shadow & found), either = cv::countNonZero(shadow | found);
    EXPECT_GT(cv::countNonZero(shadow), 1000);
    EXPECT_GT(overlap / either, 0.9) << projector.transpose();
    cv::Mat wrong = (shadow != found) & calm;
    EXPECT_LT(cv::countNonZero(wrong), cv::countNonZero(calm) / 200);
  }
}

TEST(ChannelsFromDepth, APlaneHasNoShadowAndItsNormal) {
  const Camera camera = camera_from_field_of_view(320, 240, 50 * EIGEN_PI / 180);
  RenderScene scene;
  const Vector3 n = Vector3(0.4, 0.2, -1).normalized();
  scene.plane = ScenePlane{n, n.dot(Vector3(0, 0, 800)), {}};
  const auto truth = make_renderer("plane")->render(scene, {camera, Vector3(100, 0, 0), 800, everything});
  const auto guess = channels_from_depth(truth->depth_mm, camera, Vector3(100, 0, 0), 800, everything);
  EXPECT_EQ(cv::countNonZero(guess->projector_gap_mm > 0.f), 0);
  // Single-precision depth: 6e-5 mm over a pixel of 2.3 mm.
  EXPECT_LT(cv::norm(truth->normal, guess->normal, cv::NORM_INF), 1e-3);
  EXPECT_LT(cv::norm(truth->ir, guess->ir, cv::NORM_INF), 1e-3);
}

TEST(ChannelsFromDepth, HolesStayHolesAndWrongImagesAreRefused) {
  const Camera camera = camera_from_field_of_view(64, 48, 0.5);
  cv::Mat depth(48, 64, CV_32F, cv::Scalar(700));
  depth.at<float>(10, 10) = 0;
  depth.at<float>(11, 11) = std::numeric_limits<float>::quiet_NaN();
  depth.at<float>(20, 20) = -3;
  const auto c = channels_from_depth(depth, camera, Vector3(50, 0, 0), 700, everything);
  EXPECT_EQ(cv::countNonZero(c->depth_mm), 48 * 64 - 3);
  EXPECT_EQ(c->cos_incidence.at<float>(11, 11), 0.f);
  EXPECT_TRUE(cv::checkRange(c->normal));
  EXPECT_TRUE(cv::checkRange(c->ir));
  EXPECT_THROW(channels_from_depth(cv::Mat(48, 64, CV_64F), camera, {}, 700, everything), Error);
  EXPECT_THROW(channels_from_depth(cv::Mat(40, 64, CV_32F), camera, {}, 700, everything), Error);
}

TEST(ApplySensor, OneCallGivesAFrame) {
  SensorModel model = read_sensor_model(std::string(BINRIG_SOURCE_DIR) + "/models/itri-2014.yaml", effect_catalogue());
  const auto truth = make_renderer("embree")->render(
      scene_with_parts(), {model.camera.resized(320, 240), Vector3(100, 0, 0), 800, everything});
  const Frame frame = apply_sensor(model, truth->depth_mm, truth->camera, 7);
  frame.check("applied");
  EXPECT_EQ(cv::norm(frame.depth_mm, apply_sensor(model, truth->depth_mm, truth->camera, 7).depth_mm, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(frame.depth_mm, apply_sensor(model, truth->depth_mm, truth->camera, 8).depth_mm, cv::NORM_INF), 0);
  cv::Mat shadow = frame.reason == static_cast<int>(Reason::shadow);
  EXPECT_GT(cv::countNonZero(shadow), 100);
  EXPECT_FALSE(frame.ir.empty());
}

}  // namespace
}  // namespace binrig
