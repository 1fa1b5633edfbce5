#include "core/coherent_noise.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"

namespace binrig {
namespace {

double covariance(const cv::Mat& image, int lag) {
  const cv::Mat a = image.colRange(0, image.cols - lag), b = image.colRange(lag, image.cols);
  return a.dot(b) / static_cast<double>(a.total());
}

class CoherentNoiseOf : public testing::TestWithParam<LatticeWeight> {};

TEST_P(CoherentNoiseOf, HasMeanZeroAndUnitDeviationOverDraws) {
  // 40 draws of 12 x 16 coarse cells: about 7700 independent cells, each with a relative variance scatter of 1.5 or
  // less, so that 1 sigma of the variance is below 0.02 and of the mean below 0.015.
  const CoherentNoise noise(192, 256, 16, GetParam());
  double mean = 0, square = 0;
  cv::Mat field;
  for (int draw = 0; draw < 40; ++draw) {
    noise.draw(RandomStream(100 + draw), field);
    mean += cv::mean(field)[0] / 40;
    square += field.dot(field) / field.total() / 40;
  }
  EXPECT_NEAR(mean, 0, 0.06);
  EXPECT_NEAR(square, 1, 0.08);
}

TEST_P(CoherentNoiseOf, IsSmoothWithinACellAndUncorrelatedBeyondIt) {
  const CoherentNoise noise(256, 512, 32, GetParam());
  double near = 0, far = 0, square = 0;
  cv::Mat field;
  for (int draw = 0; draw < 30; ++draw) {
    noise.draw(RandomStream(500 + draw), field);
    near += covariance(field, 1) / 30;
    far += covariance(field, 70) / 30;  // gradients of cells that share no node: exactly independent
    square += field.dot(field) / field.total() / 30;
  }
  EXPECT_GT(near, 0.97 * square);
  EXPECT_NEAR(far, 0, 0.05);
}

TEST_P(CoherentNoiseOf, NoPixelIsLeftUndisturbed) {
  // Gradient noise vanishes at lattice points; the random shift moves them, so that over draws every pixel varies
  // alike.
  const CoherentNoise noise(32, 32, 8, GetParam());
  cv::Mat field, square = cv::Mat::zeros(32, 32, CV_32F);
  for (int draw = 0; draw < 400; ++draw) {
    noise.draw(RandomStream(draw), field);
    square += field.mul(field) / 400;
  }
  double low, high;
  cv::minMaxLoc(square, &low, &high);
  EXPECT_GT(low, 0.6);  // 400 draws: 1 sigma 0.09 of a pixel's variance; 1024 pixels reach 3.5 sigma
  EXPECT_LT(high, 1.45);
}

TEST_P(CoherentNoiseOf, SameStreamSameBytes) {
  const CoherentNoise noise(50, 70, 20, GetParam());
  cv::Mat a, b, c;
  noise.draw(RandomStream(3), a);
  noise.draw(RandomStream(3), b);
  noise.draw(RandomStream(4), c);
  EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(a, c, cv::NORM_INF), 0.1);
}

TEST_P(CoherentNoiseOf, NoValueIsBeyondTheBound) {
  double furthest = 0;
  for (const double share : {0.0, 0.5, 1.0})
    for (std::uint64_t k = 0; k < 100; ++k) {
      DisturbanceField field(60, 80, 20, share, GetParam(), RandomStream(k));
      double low, high;
      cv::minMaxLoc(field.at(RandomStream(1000 + k)), &low, &high);
      EXPECT_LE(std::max(-low, high), field.bound());
      furthest = std::max(furthest, std::max(-low, high) / field.bound());
    }
  EXPECT_GT(furthest, 0.4);  // a bound that nothing comes near would be of no use
}

INSTANTIATE_TEST_SUITE_P(Weights, CoherentNoiseOf, testing::Values(LatticeWeight::cubic, LatticeWeight::quintic),
                         [](const auto& info) { return info.param == LatticeWeight::cubic ? "cubic" : "quintic"; });

TEST(CoherentNoise, CubicVarianceIsItsIntegral) {
  // w = 1 - 3t^2 + 2t^3: int w^2 = 13/35, int w^2 t^2 = 19/630 (by hand).
  EXPECT_NEAR(gradient_noise_variance(LatticeWeight::cubic), 4.0 * 13 / 35 * 19 / 630, 1e-5);
}

TEST(CoherentNoise, TooFineLatticeIsAnError) { EXPECT_THROW(CoherentNoise(10, 10, 3), Error); }

TEST(DisturbanceField, ShareOfTheVarianceChangesFromFrameToFrame) {
  for (const double share : {0.0, 0.3, 1.0}) {
    DisturbanceField field(200, 300, 12, share, LatticeWeight::cubic, RandomStream(1));
    const cv::Mat first = field.at(RandomStream(10)).clone(), second = field.at(RandomStream(11)).clone();
    const double own = 0.5 * (first.dot(first) + second.dot(second));
    // 400 coarse cells: correlations scatter by about 0.05.
    EXPECT_NEAR(first.dot(second) / own, 1 - share, 0.2) << share;
    EXPECT_NEAR(own / first.total(), 1, 0.25) << share;
  }
}

}  // namespace
}  // namespace binrig
