// The recorded fixtures hold what their README says.
#include <gtest/gtest.h>

#include <numbers>

#include <Eigen/Cholesky>
#include <opencv2/core.hpp>

#include "sim/dot_pattern/parameters.h"
#include "sim/effect.h"
#include "sim/scene_forward_model.h"

namespace binrig {
namespace {

std::string fixture(const std::string& name) { return BINRIG_SOURCE_DIR "/fixtures/recorded/" + name; }

// a of d + a r^2 (px), fitted together with what a pose or a baseline may do to a plane's disparity: an offset and a
// tilt.
double dome_px(const CaptureReader& capture) {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  for (int i = 0; i < capture.size(); ++i) {
    const Frame frame = capture.frame(i);
    const ImageCoordinates at(frame.camera);
    for (int v = 0; v < frame.depth_mm.rows; ++v) {
      for (int u = 0; u < frame.depth_mm.cols; ++u) {
        const double z = frame.depth_mm.at<float>(v, u);
        if (z <= 0) continue;
        const Eigen::Vector4d row(1, at.x(u), at.y(v), at.r2(u, v));  // a plane's disparity is linear in the image
        normal += row * row.transpose();
        right += row * (frame.camera.fx * 100 / z);
      }
    }
  }
  return normal.ldlt().solve(right)[3];
}

// The wedge's shift is 0.15 px r^2. The clean static pattern (0.05 mm of 1.7 mm) leaves 0.02 px. With the dome a plane
// runs through more than half a period of pixel locking, whose half swing of 0.1 px of the matched image is 0.025 px
// here; what of it looks like r^2 differs from distance to distance, and goes down in the mean of ten.
TEST(RecordedFixtures, ADomeIsInTheImperfectCampaignAndNotInTheCleanOne) {
  const RecordingSet clean = RecordingSet::open(fixture("campaign-clean"));
  const RecordingSet imperfect = RecordingSet::open(fixture("campaign-imperfect"));
  int planes = 0;
  double sum = 0;
  for (const CaptureInfo& info : clean.captures()) {
    if (info.target != TargetKind::plane) continue;
    ++planes;
    EXPECT_NEAR(dome_px(clean.capture(info.key())), 0, 0.02) << info.key();
    const double dome = dome_px(imperfect.capture(info.key()));
    EXPECT_NEAR(dome, 0.15, 0.05) << info.key();
    sum += dome;
  }
  ASSERT_EQ(planes, 10);
  EXPECT_NEAR(sum / planes, 0.15, 0.025);
}

// Nominal geometry explains every capture to within the draws of pose_sigma: 0.15 mm and 0.3 mrad over 110 mm, so 4
// sigma are 0.65 mm; locking and steps add up to 0.1 px of the matched image (0.3 mm).
TEST(RecordedFixtures, NominalScenesExplainTheCleanCampaign) {
  const RecordingSet set = RecordingSet::open(fixture("campaign-clean"));
  const SceneForwardModel forward(set);
  ASSERT_EQ(forward.captures().size(), 20u);
  const SensorModel perfect = parse_sensor_model("name: perfect\n", "perfect", effect_catalogue());
  for (int c = 0; c < 20; ++c) {
    const CaptureInfo& info = forward.captures()[c];
    const auto channels = forward.perfect(c, 0, {}, Channel::depth | Channel::normal | Channel::edge_distance, perfect);
    const Frame frame = set.capture(info.key()).frame(0);
    std::vector<double> errors;
    for (int v = 0; v < frame.depth_mm.rows; ++v) {
      for (int u = 0; u < frame.depth_mm.cols; ++u) {
        const float z = frame.depth_mm.at<float>(v, u);
        if (z > 0 && channels->edge_px.at<float>(v, u) > 4) errors.push_back(z - channels->depth_mm.at<float>(v, u));
      }
    }
    ASSERT_GT(errors.size(), 6000u) << info.key();
    std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
    EXPECT_LT(std::abs(errors[errors.size() / 2]), 0.95) << info.key();
  }
}

// 24 frames of 76800 correlated pixels: the pooled temporal deviation is known to well under 1 %.
TEST(RecordedFixtures, PlaneSourceHasTheNoiseItSays) {
  const RecordingSet set = RecordingSet::open(fixture("plane-source"));
  double sum = 0;
  int count = 0;
  for (const CaptureInfo& info : set.captures()) {
    const CaptureReader capture = set.capture(info.key());
    for (int i = 1; i < capture.size(); ++i) {
      const cv::Mat step = capture.frame(i).depth_mm - capture.frame(i - 1).depth_mm;
      sum += step.dot(step) / 2;
      count += static_cast<int>(step.total());
    }
  }
  EXPECT_NEAR(std::sqrt(sum / count), 0.25, 0.005);
}

TEST(RecordedFixtures, EveryInstrumentOfThisProjectCanBeBuilt) {
  for (const char* file :
       {"/models/dot-pattern.yaml", "/models/dot-pattern-imperfect.yaml", "/models/dot-pattern-kinect.yaml",
        "/fixtures/recorded/sensors/clean.yaml", "/fixtures/recorded/sensors/imperfect.yaml"}) {
    const SensorModel model = read_sensor_model(std::string(BINRIG_SOURCE_DIR) + file, effect_catalogue());
    EXPECT_TRUE(model.dot_pattern) << file;
    EXPECT_NO_THROW(dot_pattern::read_parameters(model)) << file;
  }
}

// The forward model serves the instrument: another recording of the step, by the sensor that recorded it, has the same
// holes but for their noisy rims (0.6 % of the pixels in either direction) and the same depth to within the pose's
// draw.
TEST(RecordedFixtures, TheForwardModelRecordsTheStepAgain) {
  const RecordingSet set = RecordingSet::open(fixture("campaign-clean"));
  SceneOptions options;
  options.with_ir = true;
  const SceneForwardModel forward(set, options);
  const SensorModel model = read_sensor_model(fixture("sensors/clean.yaml"), effect_catalogue());
  SimulationRequest request;
  while (forward.captures()[request.capture].name != "step") ++request.capture;
  request.model = &model;
  request.frames = 1;
  const Frame recorded = set.capture(forward.captures()[request.capture].key()).frame(0);
  int frames = 0;
  forward.simulate(request, [&](const Frame& frame, int) {
    ++frames;
    frame.check("simulated");
    EXPECT_EQ(frame.ir.type(), CV_16U);
    EXPECT_TRUE(frame.camera == recorded.camera);
    const cv::Mat differ = (frame.reason == 0) != (recorded.reason == 0),
                  both = (frame.depth_mm > 0) & (recorded.depth_mm > 0);
    EXPECT_LT(cv::countNonZero(differ), 0.012 * frame.reason.total());
    EXPECT_LT(cv::mean(cv::abs(frame.depth_mm - recorded.depth_mm), both)[0], 0.65);
    EXPECT_GT(cv::countNonZero(frame.reason == static_cast<int>(Reason::no_match)), 100) << "the shadow";
  });
  EXPECT_EQ(frames, 1);
}

}  // namespace
}  // namespace binrig
