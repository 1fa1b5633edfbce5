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

TEST(SpeckleNoise, HasItsAmplitudeAndTheAutocovarianceOfAGaussianFilter) {
  // As for fixed_pattern_noise: 25 captures, 17000 independent patches, 1 % scatter of a variance.
  const double amplitude = 0.3, length = 3;
  double variance = 0, lagged[2] = {0, 0};
  for (int recording = 0; recording < 25; ++recording) {
    const cv::Mat map = error({{"amplitude", amplitude}, {"correlation_length", length}},
                              {.seed = static_cast<std::uint64_t>(recording)});
    variance += map.dot(map) / map.total() / 25;
    for (int i = 0; i < 2; ++i) {
      const int lag = 3 * (i + 1);
      const cv::Mat a = map.colRange(0, 320 - lag), b = map.colRange(lag, 320);
      lagged[i] += a.dot(b) / a.total() / 25;
    }
  }
  EXPECT_NEAR(variance, amplitude * amplitude, 0.05 * amplitude * amplitude);
  EXPECT_NEAR(lagged[0] / variance, std::exp(-9 / 36.0), 0.03);
  EXPECT_NEAR(lagged[1] / variance, std::exp(-36 / 36.0), 0.03);
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
