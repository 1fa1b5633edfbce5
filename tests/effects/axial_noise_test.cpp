#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(AxialNoise, DeviationGoesWithThePowerOfTheDistance) {
  // 4 frames of 19200 white pixels: 0.4 % scatter (1 sigma) of each deviation.
  for (const double exponent : {1.0, 2.0, 3.0}) {
    for (const double z : {400.0, 800.0, 1600.0}) {
      EXPECT_NEAR(
          test::noise_under("axial_noise", {{"exponent", exponent}}, test::plane_scene(z), test::small_camera()),
          std::pow(z / 800, exponent), 0.02 * std::pow(z / 800, exponent));
    }
  }
}

}  // namespace
}  // namespace binrig
