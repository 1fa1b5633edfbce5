#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

int band(double z, double projector_x, int from_column, int step) {
  CaptureContext context = test::analytic_context(test::plane_scene(z), test::small_camera());
  context.projector_xyz_mm = Vector3(projector_x, 0, 0);
  Channels channels;
  channels.depth_mm = cv::Mat(120, 160, CV_32F, cv::Scalar(z));
  const Layers layers =
      test::EffectUnderTest(test::make_instance("border_band", {{"width", 12}}), context).frame(channels);
  int width = 0;
  while (layers.reason.at<std::uint8_t>(50, from_column + step * width) == static_cast<int>(Reason::border)) ++width;
  EXPECT_EQ(cv::countNonZero(layers.reason), 120 * width);  // nothing anywhere else
  return width;
}

TEST(BorderBand, WidthIsInverseToTheDistanceAndTheSideIsTheProjectors) {
  EXPECT_EQ(band(800, 75, 0, 1), 12);
  EXPECT_EQ(band(400, 75, 0, 1), 24);
  EXPECT_EQ(band(1600, 75, 0, 1), 6);
  EXPECT_EQ(band(800, -75, 159, -1), 12);
}

}  // namespace
}  // namespace binrig
