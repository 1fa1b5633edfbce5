#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "core/camera.h"
#include "core/error.h"
#include "core/frame.h"
#include "core/pose.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

Camera lens(std::array<double, 8> distortion) {
  Camera camera = camera_from_field_of_view(640, 480, 1.0);
  camera.distortion = distortion;
  return camera;
}

// Property: ray() inverts project(), for lenses as strong as real ones (a few per cent in the corners).
TEST(Camera, RayAndProjectionAreInverse) {
  for (const Camera& camera : {lens({}), lens({0.12, -0.25, 1e-3, -5e-4, 0.1, 0, 0, 0}),
                               lens({-0.2, 0.05, 0, 2e-3, 0, 0.02, -0.01, 0.003})}) {
    for (double v : {0.0, 100.3, 239.5, 479.0}) {
      for (double u : {0.0, 11.1, 319.5, 639.0}) {
        const Eigen::Vector3d ray = camera.ray(u, v);
        EXPECT_EQ(ray.z(), 1);
        const Eigen::Vector2d back = camera.project(ray * 812.5);
        EXPECT_NEAR(back.x(), u, 1e-7);
        EXPECT_NEAR(back.y(), v, 1e-7);
      }
    }
  }
}

TEST(Camera, FieldOfViewIsThatOfTheImagesEdges) {
  const Camera camera = camera_from_field_of_view(640, 480, 1.0);
  EXPECT_NEAR(std::atan(-camera.ray(-0.5, 0).x()) + std::atan(camera.ray(639.5, 0).x()), 1.0, 1e-12);
}

TEST(Camera, ResizingKeepsPixelEdges) {
  const Camera camera = lens({0.1, 0, 0, 0, 0, 0, 0, 0}), half = camera.resized(320, 240);
  for (double edge : {-0.5, 99.5, 639.5}) {
    EXPECT_NEAR(camera.ray(edge, 239.5).x(), half.ray((edge + 0.5) / 2 - 0.5, 119.5).x(), 1e-12);
  }
}

TEST(Camera, EveryBadNumberIsNamed) {
  Camera camera;
  camera.width = -1;
  camera.height = 480;
  camera.fx = 0;
  camera.fy = std::nan("");
  try {
    camera.check("here");
    FAIL();
  } catch (const Error& problem) {
    EXPECT_EQ(problem.violations().size(), 3u) << problem.what();
  }
}

TEST(ImageCoordinates, CornerHasUnitRadius) {
  const Camera camera = camera_from_field_of_view(640, 480, 1.0);
  const ImageCoordinates coordinates(camera);
  EXPECT_NEAR(coordinates.r2(camera.cx + 320, camera.cy + 240), 1, 1e-12);
  EXPECT_NEAR(coordinates.r2(camera.cx, camera.cy), 0, 1e-12);
}

TEST(Pose, RowsAreProjectedOntoRotationsAndNonsenseIsRefused) {
  const double good[9] = {1, 1e-5, 0, -1e-5, 1, 0, 0, 0, 1}, place[3] = {1, 2, 3};
  const Pose pose = pose_from_rows(good, place);
  EXPECT_NEAR((pose.linear() * pose.linear().transpose() - Eigen::Matrix3d::Identity()).norm(), 0, 1e-14);
  EXPECT_EQ(pose.translation(), Vector3(1, 2, 3));
  const double stretched[9] = {1.1, 0, 0, 0, 1, 0, 0, 0, 1}, mirrored[9] = {-1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double nan[3] = {0, std::nan(""), 0};
  EXPECT_THROW(pose_from_rows(stretched, place), Error);
  EXPECT_THROW(pose_from_rows(mirrored, place), Error);
  EXPECT_THROW(pose_from_rows(good, nan), Error);
}

TEST(Pose, SmallMotionTurnsAboutItsCentre) {
  Vector6 motion;
  motion << 0.1, -0.2, 0.3, 1, 2, 3;
  const Vector3 centre(10, 20, 700);
  const Pose pose = small_motion(motion, centre);
  EXPECT_NEAR((pose * centre - centre - Vector3(1, 2, 3)).norm(), 0, 1e-10);
  EXPECT_NEAR(rotation_between_rad(Pose::Identity(), pose), Vector3(0.1, -0.2, 0.3).norm(), 1e-12);
  EXPECT_TRUE(small_motion(Vector6::Zero(), centre).matrix().isIdentity(0));
}

TEST(Frame, ChecksSayWhatIsWrongAndWhere) {
  const auto refused = [](auto spoil) -> std::string {
    Frame frame = test::full_frame(0);
    spoil(frame);
    try {
      frame.check("here");
    } catch (const Error& problem) {
      return problem.what();
    }
    return "";
  };
  EXPECT_EQ(refused([](Frame&) {}), "");
  EXPECT_NE(refused([](Frame& f) { f.depth_mm = cv::Mat(3, 4, CV_32F, cv::Scalar(1)); }).find("24 x 16"), std::string::npos);
  EXPECT_NE(refused([](Frame& f) { f.reason.convertTo(f.reason, CV_16U); }).find("reason"), std::string::npos);
  EXPECT_NE(refused([](Frame& f) { f.depth_mm.at<float>(2, 1) = std::nanf(""); }).find("(1, 2)"), std::string::npos);
  EXPECT_NE(refused([](Frame& f) { f.depth_mm.at<float>(2, 1) = -3; }).find("-3"), std::string::npos);
  EXPECT_NE(refused([](Frame& f) { f.reason.at<std::uint8_t>(2, 1) = 2; }).find("shadow"), std::string::npos);
  EXPECT_NE(refused([](Frame& f) { f.missing_share = 2; }).find("missing_share"), std::string::npos);
}

TEST(Reason, NamesGoBothWays) {
  for (int i = 0; i < reason_count; ++i) {
    const Reason reason = static_cast<Reason>(i);
    EXPECT_EQ(reason_from_name(reason_name(reason)), reason);
  }
  EXPECT_FALSE(reason_from_name("gremlins").has_value());
}

}  // namespace
}  // namespace binrig
