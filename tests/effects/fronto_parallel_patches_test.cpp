#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

const char* const effect = "fronto_parallel_patches";

// A plane of slope 0.0547 mm a pixel, the same everywhere (z = 800 / (1 - x tan a), f = 20000 px).
class PatchesOnASlope : public testing::Test {
 protected:
  const double tilt_ = 0.94, slope_mm_ = 800 * std::tan(tilt_) / 20000;
  const test::AnalyticScene plane_ = test::plane_scene(800, tilt_);
  const CaptureContext context_ = test::analytic_context(plane_, test::narrow_camera());
  const std::shared_ptr<const Channels> channels_ =
      test::analytic_channels(plane_, context_.camera, context_.projector_xyz_mm, 800);

  /// What the effect adds, far from the image's border.
  cv::Mat error(const test::Values& values, int frame = 0) const {
    test::EffectUnderTest under_test(test::make_instance(effect, values), context_);
    cv::Mat last;
    for (int i = 0; i <= frame; ++i) last = under_test.frame(*channels_, i).depth_mm - channels_->depth_mm;
    return last(cv::Rect(20, 20, last.cols - 40, last.rows - 40));
  }
};

/// Share of neighbours in a row that differ by no more than `tolerance`.
double level(const cv::Mat& image, double tolerance) {
  const cv::Mat step = cv::abs(image.colRange(1, image.cols) - image.colRange(0, image.cols - 1));
  return cv::countNonZero(step <= tolerance) / static_cast<double>(step.total());
}

TEST_F(PatchesOnASlope, AWholePatchHasTheDepthOfItsPoint) {
  const cv::Mat plane =
      channels_->depth_mm(cv::Rect(20, 20, channels_->depth_mm.cols - 40, channels_->depth_mm.rows - 40));
  // Patches some 9 px wide: one pair of neighbours in nine is of two of them.
  EXPECT_NEAR(level(error({{"hold", 1}, {"slant", 0}, {"pitch", 9}}) + plane, 0.1 * slope_mm_), 1 - 1.0 / 9, 0.06);
}

TEST_F(PatchesOnASlope, TheErrorGrowsWithHoldAndPitchAndFallsWithTheSlant) {
  // Points on a square lattice would lie uniformly in a square of pitch: pitch / sqrt(12) = 0.29 pitch along the
  // slope. Points without any order would lie at 0.40 pitch: their mean square distance from a pixel is pitch^2 / pi in
  // two directions. One in each square, anywhere in it, is between.
  for (const double pitch : {5.0, 10.0}) {
    const auto [mean, deviation] = test::mean_and_deviation(error({{"hold", 1}, {"slant", 0}, {"pitch", pitch}}));
    EXPECT_GT(deviation, 0.29 * pitch * slope_mm_);
    EXPECT_LT(deviation, 0.40 * pitch * slope_mm_);
    EXPECT_NEAR(mean, 0, 0.1 * deviation);
    for (const auto& [hold, slant] : {std::pair(0.3, 0.0), std::pair(1.0, 0.7), std::pair(0.6, 0.5)}) {
      const cv::Mat weaker = error({{"hold", hold}, {"slant", slant}, {"pitch", pitch}});
      EXPECT_NEAR(test::mean_and_deviation(weaker).second, hold * (1 - slant) * deviation, 0.01 * deviation);
    }
  }
}

TEST_F(PatchesOnASlope, TheStepsAreSkewedToTheSideToWhichThePlaneFallsAway) {
  // Less than the slope from pixel to pixel within a patch, and a jump from one to the next.
  const cv::Mat e = error({{"hold", 1}, {"slant", 0}, {"pitch", 8}});
  const cv::Mat step = e.colRange(1, e.cols) - e.colRange(0, e.cols - 1);
  const double deviation = test::mean_and_deviation(step).second;
  const double skewness = cv::mean(step.mul(step).mul(step))[0] / std::pow(deviation, 3);
  EXPECT_GT(skewness, 1);  // z grows with u: a patch of n pixels makes n - 1 steps of -s and one of (n - 1) s
}

TEST_F(PatchesOnASlope, TheyStayThroughACapture) {
  const test::Values values{{"hold", 1}, {"pitch", 7}};
  EXPECT_EQ(cv::norm(error(values, 0), error(values, 2)), 0);
}

TEST(FrontoParallelPatches, NoiseIsThatOfThePoint) {
  const test::AnalyticScene scene = test::plane_scene(800);
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  Layers layers = test::fresh_layers(*channels);
  RandomStream(5).fill_normal(layers.noise_mm);
  const double before = test::mean_and_deviation(layers.noise_mm).second;
  test::EffectUnderTest(test::make_instance(effect, {{"hold", 1}, {"slant", 0.8}, {"pitch", 8}}), context)
      .apply(layers, *channels);
  EXPECT_NEAR(level(layers.noise_mm, 1e-5), 1 - 1.0 / 8, 0.06);
  // 19200 pixels, but only 300 points.
  EXPECT_NEAR(test::mean_and_deviation(layers.noise_mm).second, before, 4 * before / std::sqrt(2 * 300.0));
}

TEST(FrontoParallelPatches, AFrontalPlaneKeepsItsDepth) {
  EXPECT_LT(cv::norm(test::depth_under(effect, {{"hold", 1}, {"slant", 0}, {"pitch", 12}}, test::plane_scene(800)),
                     cv::Mat(120, 160, CV_32F, 800.f), cv::NORM_INF),
            1e-3);
}

TEST(FrontoParallelPatches, PatchesEndAtAnEdge) {
  test::AnalyticScene scene = test::plane_scene(800);
  scene.box = {Vector3(-100, -70, 690), Vector3(100, 70, 700)};
  const cv::Mat depth = test::depth_under(effect, {{"hold", 1}, {"slant", 0}, {"pitch", 9}}, scene);
  const CaptureContext context = test::analytic_context(scene, test::small_camera());
  const auto channels = test::analytic_channels(scene, context.camera, context.projector_xyz_mm, 800);
  EXPECT_LT(cv::norm(depth, channels->depth_mm, cv::NORM_INF), 1e-3);  // both surfaces face the camera
}

}  // namespace
}  // namespace binrig
