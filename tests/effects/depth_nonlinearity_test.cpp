#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(DepthNonlinearity, IsAParabolaAboutTheReferenceDistance) {
  const auto error = [](double z) {
    return cv::mean(test::depth_under("depth_nonlinearity", {{"amplitude", 1.5}}, test::plane_scene(z)))[0] - z;
  };
  EXPECT_NEAR(error(800), 0, 1e-3);
  EXPECT_NEAR(error(900), 1.5, 1e-3);
  EXPECT_NEAR(error(700), 1.5, 1e-3);
  EXPECT_NEAR(error(1000), 6, 1e-3);
}

}  // namespace
}  // namespace binrig
