#include <cmath>
#include <complex>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

cv::Mat noise(const test::Values& values, int number) {
  Camera camera = test::small_camera().resized(256, 192);
  const CaptureContext context = test::analytic_context(test::plane_scene(800), camera);
  Channels channels;
  channels.depth_mm = cv::Mat(192, 256, CV_32F, cv::Scalar(800));
  return test::EffectUnderTest(test::make_instance("noise_bumps", values), context).frame(channels, number).noise_mm;
}

/// Power of an image at a frequency along a row or column, by a plain sum.
double power(const cv::Mat& image, double fx, double fy) {
  std::complex<double> sum;
  for (int row = 0; row < image.rows; ++row) {
    for (int col = 0; col < image.cols; ++col) {
      sum += static_cast<double>(image.at<float>(row, col)) * std::polar(1.0, -2 * CV_PI * (fx * col + fy * row));
    }
  }
  return std::norm(sum);
}

TEST(NoiseBumps, PowerLiesOnARingAndHasTheGivenDeviation) {
  const test::Values values{{"amplitude", 0.3}, {"frequency", 0.1875}, {"width", 0.03}};
  const cv::Mat n = noise(values, 0);
  EXPECT_NEAR(test::mean_and_deviation(n).second, 0.3, 0.003);
  // Fixed magnitudes: the ratio of two frequencies is that of the Gaussian. 0.1875 = 48/256 = 36/192.
  const double on_ring = power(n, 48 / 256.0, 0);
  EXPECT_NEAR(power(n, 0, 36 / 192.0) / on_ring, 1, 0.01);
  EXPECT_NEAR(power(n, 56 / 256.0, 0) / on_ring, std::exp(-std::pow(8 / 256.0 / 0.03, 2) / 2), 0.02);
  EXPECT_LT(power(n, 110 / 256.0, 0), 1e-4 * on_ring);
}

TEST(NoiseBumps, IsNewInEveryFrame) {
  const cv::Mat a = noise({{"amplitude", 0.3}}, 0), b = noise({{"amplitude", 0.3}}, 1);
  // A ring of radius 0.15 and width 0.02 has some 256 * 192 * 2 pi 0.15 * 0.05 = 2000 independent values.
  EXPECT_NEAR(a.dot(b) / a.dot(a), 0, 0.12);
}

}  // namespace
}  // namespace binrig
