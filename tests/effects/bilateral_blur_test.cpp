#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

Layers flat(float z_mm, double sigma_mm) {
  Layers layers;
  layers.depth_mm = cv::Mat(120, 160, CV_32F);
  RandomStream(9).fill_normal(layers.depth_mm);
  layers.depth_mm = layers.depth_mm * sigma_mm + z_mm;
  layers.reason = cv::Mat::zeros(120, 160, CV_8U);
  return layers;
}

void blur(Layers& layers, const test::Values& values) {
  CaptureContext context;
  context.camera = test::small_camera();
  test::EffectUnderTest(test::make_instance("bilateral_blur", values), context).apply(layers, Channels{});
}

TEST(BilateralBlur, SmallNoiseShrinksAsTheGaussianKernelSays) {
  // Noise well below sigma_z: range weights are 1, and white noise shrinks to sqrt(sum w^2) / sum w.
  for (const double sigma_px : {0.7, 1.5}) {
    Layers layers = flat(800, 0.1);
    blur(layers, {{"sigma_px", sigma_px}, {"sigma_z", 100}, {"diameter", 7}});
    double sum = 0, square = 0;
    for (int j = -3; j <= 3; ++j) {
      for (int i = -3; i <= 3; ++i) {
        const double w = std::exp(-(i * i + j * j) / (2 * sigma_px * sigma_px));
        sum += w;
        square += w * w;
      }
    }
    const auto [mean, deviation] = test::mean_and_deviation(layers.depth_mm(cv::Rect(4, 4, 152, 112)));
    // 17000 pixels correlated over about 4 sigma_px^2 pi of them: at most 3 % scatter (1 sigma).
    EXPECT_NEAR(deviation, 0.1 * std::sqrt(square) / sum, 0.08 * 0.1 * std::sqrt(square) / sum) << sigma_px;
    EXPECT_NEAR(mean, 800, 0.01);
  }
}

TEST(BilateralBlur, StepsWellBeyondSigmaZStaySharp) {
  Layers layers = flat(800, 0.0);
  layers.depth_mm.colRange(80, 160).setTo(820);
  blur(layers, {{"sigma_px", 2}, {"sigma_z", 2}, {"diameter", 9}});
  EXPECT_EQ(cv::norm(layers.depth_mm.colRange(0, 80), cv::Mat(120, 80, CV_32F, 800.f), cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(layers.depth_mm.colRange(80, 160), cv::Mat(120, 80, CV_32F, 820.f), cv::NORM_INF), 0);
}

TEST(BilateralBlur, AgreesWithTheExactExponentialToTheStatedError) {
  struct Blur {
    double sigma_px;
    int diameter;
  };
  for (const auto& [sigma_px, diameter] : {Blur{1.2, 5}, Blur{0.6, 9}}) {  // of the second, most weights are left out
    Layers layers = flat(800, 2.0);
    const cv::Mat before = layers.depth_mm.clone();
    blur(layers, {{"sigma_px", sigma_px}, {"sigma_z", 2}, {"diameter", static_cast<double>(diameter)}});
    const int radius = diameter / 2;
    double worst = 0;
    for (int row = radius; row < 120 - radius; ++row) {
      for (int col = radius; col < 160 - radius; ++col) {
        double sum = 0, weight = 0;
        const double centre = before.at<float>(row, col);
        for (int j = -radius; j <= radius; ++j) {
          for (int i = -radius; i <= radius; ++i) {
            const double z = before.at<float>(row + j, col + i);
            const double w = std::exp(-(i * i + j * j) / (2 * sigma_px * sigma_px) - (z - centre) * (z - centre) / 8);
            sum += w * z;
            weight += w;
          }
        }
        worst = std::max(worst, std::abs(sum / weight - layers.depth_mm.at<float>(row, col)));
      }
    }
    // Each weight is wrong by at most 0.0011 of its spatial weight, worst where the difference is 2.5 sigma_z = 5 mm;
    // the spatial weights of the 24 neighbours of the first add up to 7.4, of the second to less: 0.0011 * 7.4 * 5 mm.
    // What is left out is some 68 weights below 1e-5, of at most 20 mm: 0.014 mm, were all as large as that.
    EXPECT_LT(worst, 0.041) << sigma_px;
  }
}

TEST(BilateralBlur, HolesStayHolesAndDoNotDragTheirRim) {
  Layers layers = flat(800, 0.0);
  layers.reason(cv::Rect(50, 50, 10, 10)).setTo(static_cast<int>(Reason::shadow));
  layers.depth_mm(cv::Rect(50, 50, 10, 10)).setTo(0);
  blur(layers, {{"sigma_px", 2}, {"sigma_z", 1000}, {"diameter", 9}});
  EXPECT_EQ(cv::countNonZero(layers.reason), 100);
  layers.depth_mm.setTo(800, layers.reason != 0);
  EXPECT_EQ(cv::norm(layers.depth_mm, cv::Mat(120, 160, CV_32F, 800.f), cv::NORM_INF), 0);
}

}  // namespace
}  // namespace binrig
