#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// The error of a wall: which capture, of which recording, by which unit.
struct Shown {
  std::uint64_t capture = 11;
  std::uint64_t seed = 1, unit_seed = 1;
  double z = 800;
  int frame = 0;
};

cv::Mat error(const test::Values& values, const Shown& shown) {
  CaptureContext context = test::analytic_context(test::plane_scene(shown.z), test::small_camera().resized(320, 240));
  context.capture_key = shown.capture;
  context.seed = shown.seed;
  context.unit_seed = shown.unit_seed;
  Channels channels;
  channels.camera = context.camera;
  channels.depth_mm = cv::Mat(240, 320, CV_32F, cv::Scalar(shown.z));
  test::EffectUnderTest under_test(test::make_instance("speckle_noise", values), context);
  cv::Mat depth;
  for (int i = 0; i <= shown.frame; ++i) depth = under_test.frame(channels, i).depth_mm - shown.z;
  return depth;
}

TEST(SpeckleNoise, IsSmoothNoiseOfItsAmplitude) {
  // 76800 / (4 pi 3^2) = 680 independent patches: 5 % scatter of a variance.
  const cv::Mat map = error({{"amplitude", 0.3}, {"correlation_length", 3}}, {});
  EXPECT_NEAR(map.dot(map) / map.total(), 0.09, 0.2 * 0.09);
}

TEST(SpeckleNoise, StaysThroughACaptureWhateverTheUnit) {
  const test::Values values{{"amplitude", 0.3}};
  const cv::Mat first = error(values, {});
  EXPECT_EQ(cv::norm(first, error(values, {.frame = 3}), cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(first, error(values, {.unit_seed = 9}), cv::NORM_INF), 0);
}

TEST(SpeckleNoise, TwoCapturesHaveNothingInCommon) {
  const test::Values values{{"amplitude", 0.3}, {"correlation_length", 2}};
  const cv::Mat first = error(values, {});
  for (const Shown& other : {Shown{.capture = 12}, Shown{.seed = 2}}) {
    const cv::Mat second = error(values, other);
    // 76800 / (4 pi 2^2) = 1500 independent patches: a correlation scatters by 0.026.
    EXPECT_NEAR(first.dot(second) / std::sqrt(first.dot(first) * second.dot(second)), 0, 4 * 0.026);
  }
}

}  // namespace
}  // namespace binrig
