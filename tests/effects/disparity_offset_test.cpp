#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(DisparityOffset, ErrorGrowsWithTheSquareOfTheDistance) {
  // f B = 200 px * 75 mm. To first order -z^2 delta / (f B); the next term is smaller by delta z / (f B).
  const double delta = 0.05, fb = 200 * 75;
  for (const double z : {500.0, 1000.0}) {
    const cv::Mat depth = test::depth_under("disparity_offset", {{"offset", delta}}, test::plane_scene(z));
    const double first_order = -z * z * delta / fb;
    EXPECT_NEAR(cv::mean(depth)[0] - z, first_order, std::abs(first_order) * 1.1 * delta * z / fb + 2e-3) << z;
  }
}

TEST(DisparityOffset, DisparityThatFallsToNothingIsOutOfRange) {
  // At 3000 mm the disparity is 5 px: an offset of -10 px leaves no depth.
  CaptureContext context = test::analytic_context(test::plane_scene(3000), test::small_camera());
  context.depth_scale_mm = 1;
  SensorModel model;
  model.effects = {test::make_instance("disparity_offset", {{"offset", -10}})};
  const auto channels = test::analytic_channels(test::plane_scene(3000), context.camera, context.projector_xyz_mm, 800);
  const Frame frame = SensorRun(model, context).frame(*channels, {});
  EXPECT_EQ(cv::countNonZero(frame.reason == static_cast<int>(Reason::out_of_range)), 160 * 120);
}

}  // namespace
}  // namespace binrig
