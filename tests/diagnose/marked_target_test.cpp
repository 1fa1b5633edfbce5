// A recording that marks its flat target says nothing of what stands beside it.
#include <gtest/gtest.h>

#include "app/forward.h"
#include "core/random.h"
#include "core/recording_writer.h"
#include "diagnose/experiment.h"
#include "sim/effect.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

constexpr int width = 96, height = 72;

/// A noisy board 700 mm away, its right two thirds marked; what stands left of it is `beside_mm` away.
Frame board(int number, float beside_mm) {
  Frame frame;
  frame.camera = camera_from_field_of_view(width, height, 0.6);
  frame.depth_scale_mm = 0.1;
  frame.depth_mm = cv::Mat(height, width, CV_32F);
  frame.reason = cv::Mat::zeros(height, width, CV_8U);
  frame.ids = cv::Mat::zeros(height, width, CV_16U);
  frame.ids.colRange(width / 3, width).setTo(1);
  cv::Mat noise(height, width, CV_32F);
  RandomStream(7).child(static_cast<std::uint64_t>(number)).fill_normal(noise);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      frame.depth_mm.at<float>(v, u) = u < width / 3 ? beside_mm : 700 + 0.3f * noise.at<float>(v, u);
    }
  if (beside_mm == 0) frame.reason.colRange(0, width / 3).setTo(static_cast<int>(Reason::unknown));
  return frame;
}

TEST(MarkedTarget, WhatStandsBesideItChangesNoStatistic) {
  test::ScratchFolder folder;
  SetInfo info;
  info.sensor.name = "test sensor";
  info.region_masks = true;
  {
    RecordingWriter writer(folder / "set", info);
    CaptureInfo capture;
    capture.split = "train";
    capture.id = 1;
    capture.target = TargetKind::plane;
    writer.begin_capture(capture);
    for (int i = 0; i < 3; ++i) writer.write(board(i, 700));
    writer.finish_capture();
  }
  const Forward forward = open_forward_model(folder / "set");
  const SensorModel model =
      parse_sensor_model("name: m\neffects:\n  - spectral_noise: {sigma: 0.3}\n", "m", effect_catalogue());
  SimulationCache cache{""};
  const Experiment experiment(*forward.model, model, cache);
  const auto measured = [&](float beside_mm) {
    std::vector<std::string> unreadable;
    return experiment.measure([&](int, int i) { return board(i, beside_mm); }, unreadable).all;
  };
  const StatVector same = measured(700), nearer = measured(450), missing = measured(0);
  ASSERT_EQ(same.size(), nearer.size());
  int known = 0;
  for (std::size_t i = 0; i < same.size(); ++i) {
    if (std::isnan(same[i])) {
      EXPECT_TRUE(std::isnan(nearer[i]) && std::isnan(missing[i])) << i;
      continue;
    }
    ++known;
    EXPECT_EQ(same[i], nearer[i]) << i;
    EXPECT_EQ(same[i], missing[i]) << i;
  }
  EXPECT_GT(known, 200);
}

}  // namespace
}  // namespace binrig
