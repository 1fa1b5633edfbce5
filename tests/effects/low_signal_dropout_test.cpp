#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

double share(double albedo, double threshold, int frame = 0) {
  const test::AnalyticScene scene = test::plane_scene(800, 0, albedo);
  CaptureContext context = test::analytic_context(scene, test::narrow_camera());
  context.projector_xyz_mm = Vector3(0, 0, 0);
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  return test::share_with(
      test::EffectUnderTest(test::make_instance("low_signal_dropout", {{"threshold", threshold}}), context)
          .frame(*channels, frame),
      Reason::low_signal);
}

TEST(LowSignalDropout, ShareIsTheNormalDistributionOfTheMargin) {
  // P(I (1 + 0.15 n) < t) = Phi((t / I - 1) / 0.15). 19200 pixels: at most 0.36 % scatter.
  for (const double ratio : {0.7, 0.85, 1.0, 1.15}) {
    const double expected = 0.5 * std::erfc(-((ratio - 1) / 0.15) / std::sqrt(2.0));
    EXPECT_NEAR(share(0.1, 0.1 * ratio), expected, 0.015) << ratio;
  }
  EXPECT_EQ(share(0.5, 0.1), 0);
  EXPECT_EQ(share(0.02, 0.1), 1);
}

}  // namespace
}  // namespace binrig
