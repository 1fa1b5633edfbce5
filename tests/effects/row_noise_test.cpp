#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/effect_run.h"

namespace binrig {
namespace {

cv::Mat noise_of_frame(int number) {
  Camera camera = test::small_camera().resized(400, 400);
  CaptureContext context = test::analytic_context(test::plane_scene(800), camera);
  Channels channels;
  channels.depth_mm = cv::Mat(400, 400, CV_32F, cv::Scalar(800));
  return test::EffectUnderTest(test::make_instance("row_noise", {{"amplitude", 0.2}}), context)
      .frame(channels, number)
      .noise_mm;
}

TEST(RowNoise, IsConstantAlongRowsAndWhiteAcrossThem) {
  double square = 0, neighbours = 0, frames = 0;
  cv::Mat previous;
  for (int number = 0; number < 10; ++number) {
    const cv::Mat m = noise_of_frame(number);
    std::vector<double> level;
    for (int i = 0; i < m.rows; ++i) {
      const auto [mean, deviation] = test::mean_and_deviation(m.row(i));
      EXPECT_LT(deviation, 1e-6);
      level.push_back(mean);
    }
    for (std::size_t i = 0; i < level.size(); ++i) {
      square += level[i] * level[i];
      if (i > 0) neighbours += level[i] * level[i - 1];
    }
    if (!previous.empty()) frames += m.dot(previous) / m.total() / 9;
    previous = m;
  }
  // 4000 levels: 2.2 % scatter of the variance, 1.6 % of a correlation.
  EXPECT_NEAR(square / 4000, 0.04, 0.004);
  EXPECT_NEAR(neighbours / square, 0, 0.08);
  EXPECT_NEAR(frames / 0.04, 0, 0.08);
}

}  // namespace
}  // namespace binrig
