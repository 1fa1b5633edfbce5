#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

TEST(Dust, SpotIsFixedHasItsAreaAndOnlyItsRimFlickers) {
  const CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  Channels channels;
  channels.depth_mm = cv::Mat(120, 160, CV_32F, cv::Scalar(800));
  test::EffectUnderTest run(test::make_instance("dust", {{"radius", 9}, {"x", -0.25}, {"y", 0.1}}), context);
  cv::Mat hits = cv::Mat::zeros(120, 160, CV_32F);
  const int count = 60;
  for (int frame = 0; frame < count; ++frame) {
    cv::Mat hit;
    cv::Mat(run.frame(channels, frame).reason == static_cast<int>(Reason::defect)).convertTo(hit, CV_32F, 1 / 255.0);
    hits += hit / count;
  }
  // Expected share at distance rho: Phi((radius - rho) / 0.7), so that the area is pi (radius^2 + 0.7^2).
  EXPECT_NEAR(cv::sum(hits)[0], CV_PI * (81 + 0.49), 5);
  const double u0 = 79.5 - 0.25 * 80, v0 = 59.5 + 0.1 * 80;
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      const double rho = std::hypot(col - u0, row - v0), share = hits.at<float>(row, col);
      if (rho < 6) {
        EXPECT_NEAR(share, 1, 1e-4);
      }
      if (rho > 12) {
        EXPECT_EQ(share, 0);
      }
    }
  }
}

}  // namespace
}  // namespace binrig
