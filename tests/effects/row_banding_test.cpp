#include <cmath>
#include <complex>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(RowBanding, IsOneLineOfTheSpectrumAtOneOverThePeriodWhateverTheDistance) {
  // 160 x 120: a period of 20 px fits a whole number of times, so that all power is in one line, (A/2)^2.
  const double amplitude = 0.4, period = 20;
  for (const double z : {500.0, 1000.0}) {
    const cv::Mat depth = test::depth_under(
        "row_banding", {{"amplitude", amplitude}, {"period", period}, {"phase", 0.7}}, test::plane_scene(z));
    std::complex<double> line;
    for (int row = 0; row < depth.rows; ++row) {
      for (int col = 0; col < depth.cols; ++col) {
        line += (depth.at<float>(row, col) - z) * std::polar(1.0, -2 * CV_PI * row / period);
      }
    }
    line /= static_cast<double>(depth.total());
    EXPECT_NEAR(std::abs(line), amplitude / 2, 1e-4);
    EXPECT_NEAR(std::arg(line), 0.7, 1e-3);
    const auto [mean, deviation] = test::mean_and_deviation(depth);
    EXPECT_NEAR(mean, z, 1e-3);
    EXPECT_NEAR(deviation, amplitude / std::sqrt(2), 1e-4);  // nothing outside the line
  }
}

}  // namespace
}  // namespace binrig
