#include <cmath>
#include <complex>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// Depth whose disparity runs evenly over whole pixels, 40 to 60 px.
Channels slope(double fb) {
  Channels channels;
  channels.camera = test::small_camera();
  channels.depth_mm = cv::Mat(120, 160, CV_32F);
  for (int row = 0; row < 120; ++row) {
    for (int col = 0; col < 160; ++col) {
      channels.depth_mm.at<float>(row, col) = static_cast<float>(fb / (40 + 20.0 * (row * 160 + col) / (120 * 160)));
    }
  }
  return channels;
}

TEST(PixelLocking, CombInTheDisparitiesIsTheBesselFunctionOfTheAmplitude) {
  // For d uniform over whole pixels, mean of exp(2 pi i (d + A sin(2 pi d))) = J_-1(2 pi A) = -J_1(2 pi A).
  const double fb = 200 * 75;
  for (const double amplitude : {0.02, 0.1}) {
    CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
    const Channels channels = slope(fb);
    const Layers layers =
        test::EffectUnderTest(test::make_instance("pixel_locking", {{"amplitude", amplitude}}), context)
            .frame(channels);
    std::complex<double> comb;
    for (int row = 0; row < 120; ++row) {
      for (int col = 0; col < 160; ++col) {
        comb += std::polar(1.0, 2 * CV_PI * fb / layers.depth_mm.at<float>(row, col)) / (120.0 * 160);
      }
    }
    EXPECT_NEAR(comb.real(), -std::cyl_bessel_j(1, 2 * CV_PI * amplitude), 2e-4);
    EXPECT_NEAR(comb.imag(), 0, 2e-4);
  }
}

TEST(PixelLocking, DisparitiesGatherAtHalfPixelsAndAtWholeOnesWithTheOppositePhase) {
  const double fb = 200 * 75;
  CaptureContext context = test::analytic_context(test::plane_scene(800), test::small_camera());
  const auto near_whole = [&](double phase) {
    const Layers layers =
        test::EffectUnderTest(test::make_instance("pixel_locking", {{"amplitude", 0.1}, {"phase", phase}}), context)
            .frame(slope(fb));
    int count = 0;
    for (int row = 0; row < 120; ++row) {
      for (int col = 0; col < 160; ++col) {
        const double d = fb / layers.depth_mm.at<float>(row, col);
        count += std::abs(d - std::round(d)) < 0.1;
      }
    }
    return count / (120.0 * 160);
  };
  EXPECT_LT(near_whole(0), 0.15);
  EXPECT_GT(near_whole(CV_PI), 0.3);  // without the effect 0.2
}

}  // namespace
}  // namespace binrig
