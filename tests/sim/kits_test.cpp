// Measured scenes against rendered ones: the bench recordings' meshes at their nominal poses.
#include <gtest/gtest.h>

#include <algorithm>

#include <opencv2/core.hpp>

#include "sim/effect.h"
#include "sim/scene_forward_model.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

SensorModel perfect_model() { return parse_sensor_model("name: perfect\n", "perfect", effect_catalogue()); }

float median(std::vector<float>& values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// Offset: the targets stood within pose_sigma (0.15 mm, 0.3 mrad) of nominal, a draw a capture, so a median offset
// beyond 4 sigma (0.6 mm) is a wrong picture, not a pose. Spread: the scatter of the pixels' mean over frames about
// that offset, as a robust standard deviation; sensor noise of 0.2 .. 0.3 mm over 4 .. 24 frames leaves 0.15 mm at
// most.
TEST(Kits, RenderedAndMeasuredMeanDepthCoincideOnEveryCapture) {
  const std::string path = test::shared_recording("bench/kit-a");
  if (path.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
  const RecordingSet set = RecordingSet::open(path);
  const SceneForwardModel forward(set);
  const SensorModel model = perfect_model();
  ASSERT_EQ(forward.captures().size(), 19u);
  for (int c = 0; c < 19; ++c) {
    const CaptureInfo& info = forward.captures()[c];
    const auto channels = forward.perfect(
        c, 0, Offset{}, Channel::depth | Channel::cos_incidence | Channel::edge_distance | Channel::normal, model);
    const CaptureReader reader = set.capture(info.key());
    cv::Mat sum = cv::Mat::zeros(channels->depth_mm.size(), CV_32F), count = sum.clone();
    for (int i = 0; i < reader.size(); ++i) {
      const Frame frame = reader.frame(i);
      sum += frame.depth_mm;
      cv::Mat valid;
      cv::Mat(frame.depth_mm > 0).convertTo(valid, CV_32F, 1.0 / 255);
      count += valid;
    }
    std::vector<float> errors;
    for (int row = 0; row < sum.rows; ++row) {
      for (int col = 0; col < sum.cols; ++col) {
        // Interior as in the statistics: 4 px from depth edges, incidence below 62 degrees.
        if (count.at<float>(row, col) < reader.size() || channels->depth_mm.at<float>(row, col) <= 0) continue;
        if (channels->edge_px.at<float>(row, col) <= 4 || channels->cos_incidence.at<float>(row, col) < 0.469f)
          continue;
        errors.push_back(sum.at<float>(row, col) / count.at<float>(row, col) - channels->depth_mm.at<float>(row, col));
      }
    }
    ASSERT_GT(errors.size(), 10000u) << info.name;
    const float offset = median(errors);
    for (float& error : errors) error = std::abs(error - offset);
    const float spread = 1.4826f * median(errors);
    EXPECT_LE(std::abs(offset), 0.6f) << info.name;
    EXPECT_LE(spread, 0.17f) << info.name;
    RecordProperty(info.key() + " offset_mm", std::to_string(offset));
    RecordProperty(info.key() + " spread_mm", std::to_string(spread));
    std::printf("%-10s %-10s offset %+.3f mm, spread %.3f mm\n", info.key().c_str(), info.name.c_str(), offset, spread);
  }
}

TEST(Kits, ShadowOfTheStepIsWhereTheRecordingHasItsHoles) {
  const std::string path = test::shared_recording("bench/kit-a");
  if (path.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
  const RecordingSet set = RecordingSet::open(path);
  const SceneForwardModel forward(set);
  const SensorModel model =
      parse_sensor_model("name: shadow\neffects:\n  - projector_shadow: {bias: 1}\n", "shadow", effect_catalogue());
  for (int c = 0; c < static_cast<int>(forward.captures().size()); ++c) {
    const CaptureInfo& info = forward.captures()[c];
    if (info.name != "step" && info.name != "step_2") continue;
    SimulationRequest request;
    request.capture = c;
    request.model = &model;
    request.frames = 1;
    cv::Mat simulated;
    forward.simulate(request, [&](const Frame& frame, int) { simulated = frame.depth_mm == 0; });
    const cv::Mat measured = set.capture(info.key()).frame(0).depth_mm == 0;
    const double both = cv::countNonZero(simulated & measured), either = cv::countNonZero(simulated | measured);
    std::printf("%-10s %-10s IoU %.3f of %.0f pixels\n", info.key().c_str(), info.name.c_str(), both / either, either);
    EXPECT_GE(both / either, 0.9) << info.name;
  }
}

}  // namespace
}  // namespace binrig
