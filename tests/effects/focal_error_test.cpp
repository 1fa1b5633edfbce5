#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "sim/sensor.h"
#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(FocalError, TiltedPlaneTurnsAsTheClosedFormSays) {
  // Plane z = z0 / (1 - x tan a) along the ray x; the true ray is (1 + e) x.
  const double tilt = 0.5, e = 0.03;
  const cv::Mat depth = test::depth_under("focal_error", {{"error", e}}, test::plane_scene(800, tilt));
  for (const int col : {5, 80, 150}) {
    const double x = (1 + e) * (col - 79.5) / 200;
    const double expected = 800 / (1 - x * std::tan(tilt));
    EXPECT_NEAR(depth.at<float>(60, col), expected, 2e-3) << col;
  }
}

TEST(FocalError, FrontalPlaneDoesNotChange) {
  const cv::Mat depth = test::depth_under("focal_error", {{"error", 0.05}}, test::plane_scene(800));
  EXPECT_LT(cv::norm(depth, cv::Mat(120, 160, CV_32F, 800.f), cv::NORM_INF), 1e-3);
}

TEST(FocalError, EdgesMoveInwardsForPositiveErrors) {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-200, -200, 700), Vector3(200, 200, 800)};
  const auto width = [&](double e) {
    return cv::countNonZero(test::depth_under("focal_error", {{"error", e}}, scene).row(60) < 750);
  };
  EXPECT_NEAR(width(0.06), 400.0 * 200 / 700 / 1.06, 1.01);
  EXPECT_NEAR(width(-0.06), 400.0 * 200 / 700 / 0.94, 1.01);
}

TEST(FocalError, ShadowsLieWhereTheLensSeesThem) {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-200, -200, 700), Vector3(200, 200, 800)};
  const double e = 0.06;
  const auto frame = [&](const Camera& camera, const std::vector<EffectInstance>& effects) {
    const CaptureContext context = test::analytic_context(scene, camera);
    SensorModel model;
    model.effects = effects;
    check_sensor_model(model, effect_catalogue());
    return SensorRun(model, context)
        .frame(*test::analytic_channels(scene, camera, context.projector_xyz_mm, context.reference_distance_mm), {});
  };
  const EffectInstance shadow = test::make_instance("projector_shadow", {{"bias", 1}});
  Camera lens = test::small_camera();
  lens.fx /= 1 + e, lens.fy /= 1 + e;
  const Frame stated = frame(test::small_camera(), {test::make_instance("focal_error", {{"error", e}}), shadow});
  const Frame true_lens = frame(lens, {shadow}), neither = frame(test::small_camera(), {shadow});
  ASSERT_GT(cv::countNonZero(true_lens.reason != neither.reason), 100) << "the scene tells them apart";
  EXPECT_EQ(cv::countNonZero(stated.reason != true_lens.reason), 0);
  EXPECT_LT(cv::norm(stated.depth_mm, true_lens.depth_mm, cv::NORM_INF), 1e-3);
}

TEST(FocalError, SkyAndSurfaceChangePlaces) {
  test::AnalyticScene scene;
  scene.has_plane = false;
  scene.sphere = test::AnalyticScene::Sphere{Vector3(0, 0, 800), 150};
  const auto measured = [&](double e) {
    const cv::Mat depth = test::depth_under("focal_error", {{"error", e}}, scene);
    return cv::countNonZero(depth == depth);
  };
  EXPECT_NEAR(measured(-0.05) / static_cast<double>(measured(0.05)), std::pow(1.05 / 0.95, 2), 0.03);
}

}  // namespace
}  // namespace binrig
