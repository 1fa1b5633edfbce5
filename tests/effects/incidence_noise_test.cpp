#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(IncidenceNoise, VarianceGrowsByTheAmplitudeAt45Degrees) {
  // theta / (pi/2 - theta) is 0, 1/2, 1 and 2 at 0, 30, 45 and 60 degrees.
  const std::pair<double, double> expected[] = {{0, 0}, {30, 0.5}, {45, 1}, {60, 2}};
  for (const auto& [degrees, q] : expected) {
    const double noise = test::noise_under("incidence_noise", {{"amplitude", 1.5}},
                                           test::plane_scene(800, degrees * CV_PI / 180), test::narrow_camera());
    EXPECT_NEAR(noise * noise, 1 + 1.5 * q * q, 0.05 * (1 + 1.5 * q * q)) << degrees;
  }
}

}  // namespace
}  // namespace binrig
