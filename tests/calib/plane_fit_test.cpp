#include "calib/plane_fit.h"

#include <cmath>
#include <functional>
#include <numbers>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/random.h"

namespace binrig {
namespace {

constexpr double degree = std::numbers::pi / 180;

struct Scene {
  Camera camera;
  PixelRays rays;
  PlaneFit truth;

  explicit Scene(double tilt_rad, double distance_mm = 800, bool lens = false)
      : camera(make_camera(lens)), rays(camera) {
    truth.normal = Vector3(std::sin(tilt_rad) * 0.8, std::sin(tilt_rad) * 0.6, -std::cos(tilt_rad));
    truth.offset_mm = truth.normal.z() * distance_mm;
  }
  static Camera make_camera(bool lens) {
    Camera camera = camera_from_field_of_view(160, 120, 0.5);
    if (lens) camera.distortion = {-0.12, 0.05, 0.001, -0.002, 0, 0, 0, 0};
    return camera;
  }
  /// Noise sigma at 800 mm, growing with z^2.
  cv::Mat measured(double sigma_mm, std::uint64_t seed) const {
    cv::Mat depth = truth.perfect_depth(rays), noise(depth.size(), CV_32F);
    RandomStream(seed).fill_normal(noise);
    for (int i = 0; i < static_cast<int>(depth.total()); ++i)
      depth.at<float>(i) += static_cast<float>(sigma_mm * std::pow(depth.at<float>(i) / 800, 2) * noise.at<float>(i));
    return depth;
  }
};

cv::Mat everything(const Scene& scene) {
  return cv::Mat(scene.camera.height, scene.camera.width, CV_8U, cv::Scalar(255));
}

std::string message(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(PlaneFit, FindsPlanesAtManyTiltsThroughALens) {
  for (bool lens : {false, true})
    for (double tilt : {0.0, 20 * degree, 45 * degree, 60 * degree}) {
      const Scene scene(tilt, 800, lens);
      const PlaneFit fit = fit_plane(scene.measured(0.3, 1), scene.rays, everything(scene));
      // 0.3 mm on 19200 pixels spread over some 200 mm: angles to 0.3 / (sqrt(19200) 60) = 4e-5 rad, offsets to 2 um;
      // five times that, and more for the steep ones.
      EXPECT_LT(std::acos(std::min(1.0, fit.normal.dot(scene.truth.normal))), 5e-4) << tilt;
      EXPECT_NEAR(fit.offset_mm, scene.truth.offset_mm, 0.1) << tilt;
      EXPECT_GT(fit.inlier_share, 0.99);
    }
}

TEST(PlaneFit, ResidualsAreTheNoiseAlongZ) {
  const Scene scene(30 * degree);
  const cv::Mat depth = scene.measured(0.3, 2);
  const PlaneFit fit = fit_plane(depth, scene.rays, everything(scene));
  const cv::Mat noise = depth - scene.truth.perfect_depth(scene.rays);
  EXPECT_LT(cv::norm(fit.residual_mm, noise, cv::NORM_INF), 0.05);
  EXPECT_NEAR(fit.rms_z_mm, cv::norm(noise) / std::sqrt(160.0 * 120), 1e-3);
  EXPECT_NEAR(fit.rms_orthogonal_mm / fit.rms_z_mm, std::cos(30 * degree), 0.02);
  EXPECT_NEAR(fit.sigma_mm / fit.rms_z_mm, 1, 0.1);
}

TEST(PlaneFit, CovarianceCoversTheTruth) {
  // Mahalanobis distance of (a, b, c) to the truth has three degrees of freedom: mean 3, over 60 fits 3 +- 0.32.
  const Scene scene(25 * degree);
  const Vector3 truth = scene.truth.normal / scene.truth.offset_mm;
  double sum = 0;
  for (int seed = 0; seed < 60; ++seed) {
    const PlaneFit fit = fit_plane(scene.measured(0.3, seed), scene.rays, everything(scene));
    const Vector3 error = fit.normal / fit.offset_mm - truth;
    sum += error.dot(fit.covariance.inverse() * error) / 60;
  }
  // The inflation is never below 1, so that the covariance is a little too large.
  EXPECT_GT(sum, 1.5);
  EXPECT_LT(sum, 4.3);
}

TEST(PlaneFit, OutliersDoNotMoveIt) {
  const Scene scene(20 * degree);
  cv::Mat depth = scene.measured(0.3, 3), draws(depth.size(), CV_32F);
  const PlaneFit clean = fit_plane(depth, scene.rays, everything(scene));
  RandomStream(9).fill_uniform(draws);
  depth.setTo(0, draws < 0.2);
  for (int i = 0; i < static_cast<int>(depth.total()); ++i)
    if (draws.at<float>(i) > 0.9) depth.at<float>(i) += 40;
  const PlaneFit fit = fit_plane(depth, scene.rays, everything(scene));
  EXPECT_LT(std::acos(std::min(1.0, fit.normal.dot(clean.normal))), 5e-4);
  EXPECT_NEAR(fit.inlier_share, 7.0 / 8, 0.01);
  EXPECT_NEAR(fit.fill_share, 0.8, 0.01);
  EXPECT_LT(fit.rms_z_mm, 0.4);  // gross outliers are not in `valid`
}

TEST(FlatRegion, IsFoundBetweenClutter) {
  const Scene scene(15 * degree);
  cv::Mat depth = scene.measured(0.3, 4);
  depth(cv::Rect(0, 0, 50, 120)) -= 60;       // a box before it
  depth(cv::Rect(100, 70, 30, 30)).setTo(0);  // a hole
  for (int row = 0; row < 40; ++row)          // a curved thing
    for (int col = 110; col < 160; ++col)
      depth.at<float>(row, col) -= static_cast<float>(20 - 0.02 * std::pow(col - 135, 2) - 0.02 * row * row);
  const PlaneFit fit = fit_plane(depth, scene.rays);
  EXPECT_LT(std::acos(std::min(1.0, fit.normal.dot(scene.truth.normal))), 1e-3);
  EXPECT_EQ(cv::countNonZero(fit.region(cv::Rect(0, 0, 50, 120))), 0);
  EXPECT_EQ(cv::countNonZero(fit.region(cv::Rect(103, 73, 24, 24))), 0);
  EXPECT_GT(cv::countNonZero(fit.region), 6000);
}

TEST(FlatRegion, SurvivesMissingPixels) {
  const Scene scene(15 * degree);
  cv::Mat depth = scene.measured(0.3, 5), draws(depth.size(), CV_32F);
  RandomStream(5).fill_uniform(draws);
  depth.setTo(0, draws < 0.4);
  EXPECT_GT(cv::countNonZero(find_flat_region(depth, scene.rays)), 12000);
}

TEST(PlaneFit, SaysWhatItCannotFit) {
  const Scene scene(10 * degree);
  const cv::Mat depth = scene.measured(0.3, 6);
  cv::Mat small = cv::Mat::zeros(depth.size(), CV_8U);
  small(cv::Rect(10, 10, 5, 4)).setTo(255);
  EXPECT_NE(message([&] { fit_plane(depth, scene.rays, small); }).find("the region has 20"), std::string::npos);

  cv::Mat broken = depth.clone();
  broken.at<float>(7, 9) = std::nanf("");
  EXPECT_NE(message([&] { fit_plane(broken, scene.rays); }).find("row 7, column 9"), std::string::npos);

  const Scene steep(85 * degree);
  EXPECT_NE(message([&] { fit_plane(steep.measured(0.05, 1), steep.rays, everything(steep)); }).find("deg"),
            std::string::npos);

  cv::Mat rough(depth.size(), CV_32F);
  RandomStream(1).fill_uniform(rough);
  rough = 600 + 400 * rough;
  EXPECT_NE(message([&] { fit_plane(rough, scene.rays); }).find("no plane"), std::string::npos);
  EXPECT_NE(message([&] { fit_plane(rough, scene.rays, everything(scene)); }).find("no plane"), std::string::npos);
  EXPECT_NE(message([&] { fit_plane(cv::Mat::zeros(depth.size(), CV_32F), scene.rays); }).find("measured pixels"),
            std::string::npos);
  EXPECT_NE(message([&] { fit_plane(cv::Mat::zeros(5, 5, CV_32F), scene.rays); }), "no error");
}

}  // namespace
}  // namespace binrig
