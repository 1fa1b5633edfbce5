#include "core/smooth_noise.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace binrig {
namespace {

const cv::Size size(320, 240);

TEST(SmoothNoise, HasItsAmplitudeAndTheAutocovarianceOfAGaussianFilter) {
  // White noise through a Gaussian of sigma L: covariance A^2 exp(-lag^2 / (4 L^2)). 25 maps of 320 x 240: about
  // 25 * 76800 / (4 pi L^2) = 17000 independent patches, 1 % scatter of a variance.
  const double amplitude = 0.3, length = 3;
  double variance = 0, lagged[2] = {0, 0};
  for (std::uint64_t key = 0; key < 25; ++key) {
    const cv::Mat map = smooth_noise(size, length, amplitude, RandomStream(key));
    variance += map.dot(map) / map.total() / 25;
    for (int i = 0; i < 2; ++i) {
      const int lag = 3 * (i + 1);
      const cv::Mat a = map.colRange(0, size.width - lag), b = map.colRange(lag, size.width);
      lagged[i] += a.dot(b) / a.total() / 25;
    }
  }
  EXPECT_NEAR(variance, amplitude * amplitude, 0.05 * amplitude * amplitude);
  EXPECT_NEAR(lagged[0] / variance, std::exp(-9 / 36.0), 0.03);
  EXPECT_NEAR(lagged[1] / variance, std::exp(-36 / 36.0), 0.03);
}

TEST(SmoothNoise, IsAsStrongAtTheBorderAsInTheMiddle) {
  double border = 0, middle = 0;
  for (std::uint64_t key = 0; key < 60; ++key) {
    const cv::Mat map = smooth_noise(size, 10, 1, RandomStream(key));
    border += cv::norm(map.col(0), cv::NORM_L2SQR) / size.height / 60;
    middle += cv::norm(map.col(160), cv::NORM_L2SQR) / size.height / 60;
  }
  // 60 columns of about 240 / 35 patches: 400 values, 7 % scatter.
  EXPECT_NEAR(border, 1, 0.25);
  EXPECT_NEAR(middle, 1, 0.25);
}

TEST(SmoothNoise, IsWhiteWithoutALength) {
  const cv::Mat map = smooth_noise(size, 0, 2, RandomStream(3));
  const cv::Mat a = map.colRange(0, size.width - 1), b = map.colRange(1, size.width);
  EXPECT_NEAR(map.dot(map) / map.total(), 4, 4 * 4 * std::sqrt(2.0 / 76800));
  EXPECT_NEAR(a.dot(b) / a.total(), 0, 4 * 4 / std::sqrt(76800.0));
}

TEST(SmoothNoise, AnotherAmplitudeIsTheSameDraw) {
  const cv::Mat one = smooth_noise(size, 4, 1, RandomStream(7)), half = smooth_noise(size, 4, 0.5, RandomStream(7));
  EXPECT_LT(cv::norm(one * 0.5, half, cv::NORM_INF), 1e-6);
  EXPECT_GT(cv::norm(one, smooth_noise(size, 4, 1, RandomStream(8)), cv::NORM_INF), 1);
}

}  // namespace
}  // namespace binrig
