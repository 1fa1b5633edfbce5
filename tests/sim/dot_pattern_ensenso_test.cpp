// The instrument's matcher on the images of a real camera: an Ensenso's infra-red pair of a board held in a hand.
#include <gtest/gtest.h>

#include <fstream>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/camera.h"
#include "core/frame.h"
#include "core/pose.h"
#include "sim/dot_pattern/matcher.h"
#include "tests/support/recordings.h"

namespace binrig::dot_pattern {
namespace {

struct Rectification {
  Camera raw;
  Eigen::Matrix3d turn;  // from the raw camera's frame to the rectified one's
  double f, cx, cy;
};

Rectification read_rectification(const nlohmann::json& side, int width, int height) {
  Rectification r;
  const auto& k = side.at("K");
  r.raw.width = width, r.raw.height = height;
  r.raw.fx = k[0], r.raw.cx = k[2], r.raw.fy = k[4], r.raw.cy = k[5];
  for (int i = 0; i < 5; ++i) r.raw.distortion[i] = side.at("dist")[i];
  for (int i = 0; i < 9; ++i) r.turn(i / 3, i % 3) = side.at("R_rect")[i];
  const auto& p = side.at("P_rect");
  r.f = p[0], r.cx = p[2], r.cy = p[5];
  return r;
}

cv::Mat rectified(const cv::Mat& image, const Rectification& r) {
  cv::Mat from(image.size(), CV_32FC2), out;
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const Eigen::Vector2d p = r.raw.project(r.turn.transpose() * Vector3((u - r.cx) / r.f, (v - r.cy) / r.f, 1));
      from.at<cv::Vec2f>(v, u) = cv::Vec2f(static_cast<float>(p.x()), static_cast<float>(p.y()));
    }
  }
  cv::remap(image, out, from, cv::noArray(), cv::INTER_CUBIC);
  out.convertTo(out, CV_16U);
  return out;
}

// Standard deviation of the points' heights over their plane after a polynomial of `order` in the plane's coordinates.
double rms_after_polynomial(const std::vector<Vector3>& points, int order) {
  Vector3 centre = Vector3::Zero();
  for (const Vector3& p : points) centre += p / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vector3& p : points) scatter += (p - centre) * (p - centre).transpose();
  const Eigen::Matrix3d axes = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors();
  const int terms = (order + 1) * (order + 2) / 2;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(terms, terms);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(terms);
  double squares = 0;
  for (const Vector3& p : points) {
    const Vector3 q = axes.transpose() * (p - centre) / 100;
    Eigen::VectorXd row(terms);
    int i = 0;
    for (int a = 0; a <= order; ++a) {
      for (int b = 0; a + b <= order; ++b) row[i++] = std::pow(q.y(), a) * std::pow(q.z(), b);
    }
    const double height = 100 * q.x();
    normal += row * row.transpose();
    right += row * height;
    squares += height * height;
  }
  return std::sqrt((squares - right.dot(normal.ldlt().solve(right))) / static_cast<double>(points.size()));
}

// Limits from the recording's own notes: 99 % matched on the board, 0.8 mm after a cubic (the board is bent).
TEST(DotPatternEnsenso, TheMatcherMeasuresARealBoard) {
  const std::string set = test::shared_recording("real/ensenso-ir-stereo");
  if (set.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
  nlohmann::json stereo;
  std::ifstream(set + "/stereo.json") >> stereo;
  const cv::Mat left_raw = cv::imread(set + "/train/000001/gray/000000.png", cv::IMREAD_UNCHANGED),
                right_raw = cv::imread(set + "/train/000001/gray_right/000000.png", cv::IMREAD_UNCHANGED);
  ASSERT_EQ(left_raw.size(), cv::Size(1280, 1024));
  const Rectification left = read_rectification(stereo.at("left"), 1280, 1024),
                      right = read_rectification(stereo.at("right"), 1280, 1024);

  MatchSettings settings;
  settings.full_scale = 255;
  settings.window_px = 15;
  settings.min_correlation = 0.4;  // eight bits, half of them ambient light
  settings.uniqueness = 0.02;
  settings.lowest_px = -120, settings.highest_px = 40;  // 320 .. 720 mm
  const Matches matches = match_blocks(rectified(left_raw, left), rectified(right_raw, right), 0, settings);

  // The board without its rim and the hand, drawn into the rectified image by eye.
  cv::Mat board = cv::Mat::zeros(1024, 1280, CV_8U);
  const std::vector<std::vector<cv::Point>> outline{
      {{345, 265}, {625, 265}, {625, 170}, {1000, 98}, {1026, 618}, {345, 618}}};
  cv::fillPoly(board, outline, 255);
  cv::erode(board, board, cv::Mat::ones(21, 21, CV_8U));

  const double baseline_mm = stereo.at("baseline_mm");
  std::vector<Vector3> points;
  for (int v = 0; v < 1024; ++v) {
    for (int u = 0; u < 1280; ++u) {
      if (!board.at<std::uint8_t>(v, u) || matches.reason.at<std::uint8_t>(v, u) != 0) continue;
      const double z = left.f * baseline_mm / (matches.disparity_px.at<float>(v, u) - (left.cx - right.cx));
      points.emplace_back((u - left.cx) / left.f * z, (v - left.cy) / left.f * z, z);
    }
  }
  const double valid = static_cast<double>(points.size()) / cv::countNonZero(board);
  const double plane = rms_after_polynomial(points, 1), cubic = rms_after_polynomial(points, 3);
  RecordProperty("valid_percent", std::to_string(100 * valid));
  RecordProperty("cubic_rms_mm", std::to_string(cubic));
  std::printf("board: %.2f %% valid, plane RMS %.2f mm, %.3f mm after a cubic\n", 100 * valid, plane, cubic);
  EXPECT_GE(valid, 0.99);
  EXPECT_LE(cubic, 0.8);
}

}  // namespace
}  // namespace binrig::dot_pattern
