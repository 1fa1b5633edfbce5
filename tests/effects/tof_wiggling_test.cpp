#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(TofWiggling, RepeatsEveryHalfWavelengthWithTheRightAmplitude) {
  const test::Values values{{"amplitude", 2}, {"wavelength", 300}, {"phase", 0.4}};
  const auto error = [&](double z) {
    return cv::mean(test::depth_under("tof_wiggling", values, test::plane_scene(z)))[0] - z;
  };
  double square = 0, highest = -1e9;
  for (int i = 0; i < 30; ++i) {  // one period of 150 mm
    const double e = error(700 + 5.0 * i);
    square += e * e / 30;
    highest = std::max(highest, e);
  }
  EXPECT_NEAR(std::sqrt(square), 2 / std::sqrt(2), 0.01);
  EXPECT_NEAR(highest, 2, 0.05);
  EXPECT_NEAR(error(733), error(883), 0.01);
  EXPECT_NEAR(error(733), -error(808), 0.01);
}

}  // namespace
}  // namespace binrig
