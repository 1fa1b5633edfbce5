#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

/// Intensity of a frontal plane with a narrow view: the albedo itself (projector at 75 mm: 1 - 1.5 (75/800)^2).
double variance_at(double albedo, double amplitude) {
  const double noise = test::noise_under("low_signal_noise", {{"amplitude", amplitude}},
                                         test::plane_scene(800, 0, albedo), test::narrow_camera());
  return noise * noise;
}

TEST(LowSignalNoise, FullShotNoiseGoesWithOneOverTheIntensity) {
  EXPECT_NEAR(variance_at(0.1, 1) / variance_at(0.4, 1), 4, 0.2);
  EXPECT_NEAR(variance_at(0.02, 1) / variance_at(0.1, 1), 5, 0.25);
  EXPECT_NEAR(variance_at(0.4, 1), 1, 0.05);
}

TEST(LowSignalNoise, HalfOfTheVarianceStays) { EXPECT_NEAR(variance_at(0.1, 0.5), 1 + 0.5 * 3, 0.12); }

TEST(LowSignalNoise, BrightSurfacesKeepAFifth) { EXPECT_NEAR(variance_at(1.0, 5), 0.2, 0.01); }

}  // namespace
}  // namespace binrig
