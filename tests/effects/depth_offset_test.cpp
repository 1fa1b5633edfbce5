#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(DepthOffset, ErrorIsTheSameAtEveryDistance) {
  for (const double z : {500.0, 1200.0}) {
    for (const double offset : {-3.0, 2.0}) {
      const cv::Mat depth = test::depth_under("depth_offset", {{"offset", offset}}, test::plane_scene(z));
      EXPECT_NEAR(cv::mean(depth)[0] - z, offset, 2e-3);
    }
  }
}

}  // namespace
}  // namespace binrig
