// What the profile says of captures whose noise is known. Tolerances: five standard errors where the profile states
// them; otherwise derived where they stand.
#include "compare/noise_profile.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "tests/compare/plane_captures.h"

namespace binrig {
namespace {

using test::made_capture;
using test::MadePlane;

TEST(NoiseProfile, FindsTemporalNoiseBesideAFixedPattern) {
  MadePlane made;
  made.frames = 12;
  made.pattern_mm = 0.5;
  made.holes = 0.1;
  const NoiseProfile p = noise_profile(made_capture(made));
  EXPECT_TRUE(p.temporal);
  EXPECT_NEAR(p.sigma_mm.value, 0.3, 5 * p.sigma_mm.standard_error);
  EXPECT_LT(p.sigma_mm.standard_error, 0.01);
  EXPECT_NEAR(p.split.temporal_mm, 0.3, 0.01);
  // The pattern's variance from 48,000 pixels: relative standard error sqrt(2 / 48000) / 2 = 0.3 %, and the temporal
  // noise left after the correction.
  EXPECT_NEAR(p.split.spatial_mm, 0.5, 0.015);
  EXPECT_NEAR(p.metrics.fill_rate, 0.9, 0.005);
  EXPECT_LT(p.white.p_value, 1e-9);
  EXPECT_GT(p.gaussian.p_value, 1e-3);
  EXPECT_GT(p.lines.no_row_noise.p_value, 1e-3);
  EXPECT_FALSE(p.quantisation.found);
  EXPECT_LT(std::abs(p.time.lag1_correlation.value), 5 * p.time.lag1_correlation.standard_error);
}

TEST(NoiseProfile, ASingleFrameIsAnUpperBoundThatHoldsThePattern) {
  MadePlane made;
  made.frames = 1;
  made.pattern_mm = 0.4;
  const NoiseProfile p = noise_profile(made_capture(made));
  EXPECT_FALSE(p.temporal);
  EXPECT_FALSE(p.split.done);
  EXPECT_NEAR(p.sigma_mm.value, 0.5, 5 * p.sigma_mm.standard_error);  // 0.3 and 0.4 in quadrature
  EXPECT_FALSE(p.time.frames_independent.done);
  EXPECT_THAT(profile_json(p)["noise_is"].get<std::string>(), testing::HasSubstr("upper bound"));
}

TEST(NoiseProfile, RowNoiseIsFoundAndMeasured) {
  MadePlane made;
  made.row_mm = 0.2;
  const NoiseProfile p = noise_profile(made_capture(made));
  EXPECT_LT(p.lines.no_row_noise.p_value, 0.01);
  EXPECT_NEAR(p.lines.row_sigma_mm(), 0.2, 0.04);
  EXPECT_GT(p.lines.no_column_noise.p_value, 0.001);
  EXPECT_NEAR(p.split.temporal_row_mm, 0.2, 0.04);
}

TEST(NoiseProfile, ColumnsOfTheFixedPatternAreToldFromPixels) {
  MadePlane made;
  made.column_pattern_mm = 0.3;
  made.pattern_mm = 0.4;
  const NoiseProfile p = noise_profile(made_capture(made));
  // 240 draws of a column: relative standard error 1 / sqrt(2 * 240) = 5 %.
  EXPECT_NEAR(p.split.column_mm, 0.3, 0.06);
  EXPECT_NEAR(p.split.pixel_mm, 0.4, 0.03);
  EXPECT_LT(p.split.row_mm, 0.05);
}

TEST(NoiseProfile, ADriftingPlaneIsMotionNotNoise) {
  MadePlane made;
  made.drift_mm = 0.7;
  const NoiseProfile p = noise_profile(made_capture(made));
  EXPECT_NEAR(p.sigma_mm.value, 0.3, 5 * p.sigma_mm.standard_error);
  // 0, 0.7, ... 3.5: standard deviation 0.7 sqrt(3.5).
  EXPECT_NEAR(p.time.offset_sigma_mm, 0.7 * std::sqrt(3.5), 0.05);
}

TEST(NoiseProfile, NoiseThatLastsIsSeen) {
  MadePlane made;
  made.memory = 0.5;
  made.frames = 20;
  const NoiseProfile p = noise_profile(made_capture(made));
  // Variogram of a first-order autoregression: 1 - 0.5^k; against lags 2 .. 5 the lag-1 value is 1 - 0.5 / 0.8789.
  EXPECT_NEAR(p.time.lag1_correlation.value, 1 - 0.5 / ((0.75 + 0.875 + 0.9375 + 0.96875) / 4), 0.05);
  EXPECT_LT(p.time.frames_independent.p_value, 1e-6);
}

TEST(NoiseProfile, NoiseThatGrowsDownwardsIsCalledSo) {
  MadePlane made;
  made.tilt_rad = 0;
  made.scale = [](int, int v) { return 0.5 + v / 200.0; };
  const NoiseProfile p = noise_profile(made_capture(made));
  EXPECT_LT(p.stationarity.equal_everywhere.p_value, 1e-6);
  EXPECT_EQ(p.stationarity.covariate, "v");
  EXPECT_GT(p.stationarity.explained, 0.8);
  made.scale = nullptr;
  EXPECT_GT(noise_profile(made_capture(made)).stationarity.equal_everywhere.p_value, 1e-3);
}

TEST(Quantisation, StepsOfDepthAreFound) {
  MadePlane made;
  made.step_mm = 1;
  made.storage_mm = 0.1;
  const auto q = noise_profile(made_capture(made)).quantisation;
  EXPECT_TRUE(q.found);
  EXPECT_EQ(q.power, 0);
  EXPECT_NEAR(q.step_mm, 1, 0.01);
}

TEST(Quantisation, StepsOfDisparityGrowWithTheSquareOfDepth) {
  MadePlane made;
  made.tilt_rad = 0.7;
  made.focal_baseline = 580 * 75;
  made.disparity_step_px = 1.0 / 8;
  made.storage_mm = 0.1;
  const auto q = noise_profile(made_capture(made)).quantisation;
  EXPECT_TRUE(q.found);
  EXPECT_EQ(q.power, 2);
  EXPECT_NEAR(q.step_mm, q.depth_mm * q.depth_mm * made.disparity_step_px / made.focal_baseline, 0.02 * q.step_mm);
}

TEST(Quantisation, TheStorageStepAloneIsNoFinding) {
  MadePlane made;
  made.storage_mm = 0.1;
  const auto q = noise_profile(made_capture(made)).quantisation;
  EXPECT_FALSE(q.found);
  EXPECT_DOUBLE_EQ(q.step_mm, 0.1);
}

TEST(PlaneMetrics, FollowTheirFormulasAndLeaveHolesOut) {
  MadePlane made;
  made.tilt_rad = 0;
  made.sigma_mm = 1e-9;
  made.frames = 1;
  made.focal_baseline = 40000;
  PlaneCapture capture = made_capture(made);
  capture.target.independent = true;
  const FrameStream plain = capture.frames;
  capture.frames = [&](const FrameSink& sink) {
    plain([&](const Frame& original, int number) {
      Frame frame = original;
      frame.depth_mm = original.depth_mm.clone();
      for (int v = 0; v < frame.depth_mm.rows; ++v) {
        for (int u = 0; u < frame.depth_mm.cols; ++u) {
          // A chequered pattern of +-0.5 mm about a plane that lies 2 mm behind; the left quarter is missing.
          frame.depth_mm.at<float>(v, u) += 2 + ((u + v) % 2 ? 0.5f : -0.5f);
          if (u < frame.depth_mm.cols / 4) invalidate(frame, v, u, Reason::unknown);
        }
      }
      sink(frame, number);
    });
  };
  const PlaneMetrics m = noise_profile(capture).metrics;
  EXPECT_DOUBLE_EQ(m.fill_rate, 0.75);
  EXPECT_NEAR(m.plane_rms_mm, 0.5, 1e-3);
  // The median of two equally frequent values, 1.5 and 2.5, is one of them.
  EXPECT_NEAR(std::abs(*m.z_accuracy_mm - 2), 0.5, 1e-3);
  EXPECT_NEAR(*m.subpixel_rms_px, 0.5 * 40000 / (800.0 * 800), 1e-4);
  EXPECT_FALSE(m.temporal_noise_mm.has_value());
  EXPECT_DOUBLE_EQ(m.percent_of_distance(8), 1);
}

TEST(NoiseProfile, WhatCannotBeJudgedIsAnError) {
  PlaneCapture small = made_capture({});
  small.target.region = cv::Mat(200, 240, CV_8U, cv::Scalar(0));
  small.target.region(cv::Rect(10, 10, 5, 4)).setTo(255);
  EXPECT_THROW(noise_profile(small), Error);
  PlaneCapture misfit = made_capture({});
  misfit.target.region = cv::Mat(100, 240, CV_8U, cv::Scalar(255));
  EXPECT_THROW(noise_profile(misfit), Error);
  PlaneCapture empty = made_capture({});
  empty.frames = [](const FrameSink&) {};
  EXPECT_THROW(noise_profile(empty), Error);
  MadePlane holes;
  holes.holes = 0.995;
  EXPECT_THROW(noise_profile(made_capture(holes)), Error);
}

}  // namespace
}  // namespace binrig
