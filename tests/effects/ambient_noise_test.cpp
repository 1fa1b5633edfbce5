#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

double variance_in(cv::Rect region, double albedo) {
  const test::Values values{{"amplitude", 2}, {"centre_x", -0.5}, {"centre_y", 0.3}, {"radius", 0.1}};
  const double noise =
      test::noise_under("ambient_noise", values, test::plane_scene(800, 0, albedo), test::small_camera(), region);
  return noise * noise;
}

TEST(AmbientNoise, IsStrongestInItsLobeAndAbsentFarFromIt) {
  // x = -0.5 is column 79.5 - 40, y = 0.3 row 59.5 + 24. A lobe of 8 px; 4 x 4 px in 4 frames: 64 values, 18 % scatter.
  const double in_lobe = variance_in(cv::Rect(38, 82, 4, 4), 0.4);
  EXPECT_NEAR(in_lobe, 1 + 2, 1.6);
  EXPECT_NEAR(variance_in(cv::Rect(100, 0, 60, 60), 0.4), 1, 0.06);
  // Twice as dark: four times the added variance.
  EXPECT_NEAR((variance_in(cv::Rect(38, 82, 4, 4), 0.2) - 1) / (in_lobe - 1), 4, 1.2);
}

}  // namespace
}  // namespace binrig
