#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

cv::Mat pattern(const test::Values& values, double z, std::uint64_t unit_seed, std::uint64_t seed) {
  Camera camera = test::small_camera().resized(320, 240);
  CaptureContext context = test::analytic_context(test::plane_scene(z), camera);
  context.unit_seed = unit_seed;
  context.seed = seed;
  Channels channels;
  channels.camera = camera;
  channels.depth_mm = cv::Mat(240, 320, CV_32F, cv::Scalar(z));
  return test::EffectUnderTest(test::make_instance("fixed_pattern_noise", values), context).frame(channels).depth_mm -
         z;
}

TEST(FixedPatternNoise, HasItsAmplitudeAndTheAutocovarianceOfAGaussianFilter) {
  // White noise through a Gaussian of sigma L: covariance A^2 exp(-lag^2 / (4 L^2)). 25 units of 320 x 240: about
  // 25 * 76800 / (4 pi L^2) = 17000 independent patches, 1 % scatter of a variance.
  const double amplitude = 0.3, length = 3;
  double variance = 0, lagged[2] = {0, 0};
  for (int unit = 0; unit < 25; ++unit) {
    const cv::Mat map = pattern({{"amplitude", amplitude}, {"correlation_length", length}}, 800, unit, 1);
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

TEST(FixedPatternNoise, BelongsToTheUnit) {
  const test::Values values{{"amplitude", 0.3}};
  const cv::Mat map = pattern(values, 800, 5, 1);
  EXPECT_LT(cv::norm(map, pattern(values, 600, 5, 99), cv::NORM_INF), 1e-3);  // other distance, other recording
  EXPECT_GT(cv::norm(map, pattern(values, 800, 6, 1), cv::NORM_INF), 0.3);    // another unit
}

TEST(FixedPatternNoise, IsAsStrongAtTheBorderAsInTheMiddle) {
  double border = 0, middle = 0;
  for (int unit = 0; unit < 60; ++unit) {
    const cv::Mat map = pattern({{"amplitude", 1}, {"correlation_length", 10}}, 800, unit, 1);
    border += cv::norm(map.col(0), cv::NORM_L2SQR) / 240 / 60;
    middle += cv::norm(map.col(160), cv::NORM_L2SQR) / 240 / 60;
  }
  // 60 columns of about 240 / 35 patches: 400 values, 7 % scatter.
  EXPECT_NEAR(border, 1, 0.25);
  EXPECT_NEAR(middle, 1, 0.25);
}

}  // namespace
}  // namespace binrig
