#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

cv::Mat pattern(const test::Values& values, double z, std::uint64_t unit_seed, std::uint64_t seed) {
  Camera camera = test::small_camera().resized(320, 240);
  CaptureContext context = test::analytic_context(test::plane_scene(z), camera);
  context.unit_seed = unit_seed;
  context.seed = seed;
  Channels channels;
  channels.camera = camera;
  channels.depth_mm = cv::Mat(240, 320, CV_32F, cv::Scalar(z));
  return test::EffectUnderTest(test::make_instance("fixed_pattern_noise", values), context).frame(channels).depth_mm -
         z;
}

TEST(FixedPatternNoise, IsSmoothNoiseOfItsAmplitude) {
  // 76800 / (4 pi 3^2) = 680 independent patches: 5 % scatter of a variance.
  const cv::Mat map = pattern({{"amplitude", 0.3}, {"correlation_length", 3}}, 800, 5, 1);
  EXPECT_NEAR(map.dot(map) / map.total(), 0.09, 0.2 * 0.09);
}

TEST(FixedPatternNoise, BelongsToTheUnit) {
  const test::Values values{{"amplitude", 0.3}};
  const cv::Mat map = pattern(values, 800, 5, 1);
  EXPECT_LT(cv::norm(map, pattern(values, 600, 5, 99), cv::NORM_INF), 1e-3);  // other distance, other recording
  EXPECT_GT(cv::norm(map, pattern(values, 800, 6, 1), cv::NORM_INF), 0.3);    // another unit
}

}  // namespace
}  // namespace binrig
