#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(DepthScale, ErrorIsTheSameShareOfEveryDepth) {
  for (const double z : {500.0, 800.0, 1200.0}) {
    const cv::Mat depth = test::depth_under("depth_scale", {{"scale", 0.01}}, test::plane_scene(z));
    EXPECT_NEAR(cv::mean(depth)[0] - z, 0.01 * z, 2e-3) << z;  // float: 1e-7 of z, summed
    EXPECT_LT(test::mean_and_deviation(depth).second, 1e-3);
  }
}

}  // namespace
}  // namespace binrig
