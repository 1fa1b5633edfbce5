#include "calib/noise_fit.h"

#include <cmath>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/random.h"

namespace binrig {
namespace {

// Frames of a slightly tilted plane with a fixed pattern and temporal noise of known spectra, in steps of 0.02 mm.
struct PlaneWorld {
  double distance_mm = 800, tilt_rad = 0.1;
  double sigma = 0.25, length = 0.8, white = 0.15;
  double fixed_sigma = 0, bend_mm = 0, step = 0.02;
  int frames = 4;
  std::uint64_t seed = 1;
  Camera camera = camera_from_field_of_view(240, 180, 0.5);

  FrameStream stream() const {
    return [*this](const FrameSink& sink) {
      const PixelRays rays(camera);
      PlaneFit plane;
      plane.normal = Vector3(std::sin(tilt_rad), 0, -std::cos(tilt_rad));
      plane.offset_mm = plane.normal.z() * distance_mm;
      const cv::Mat perfect = plane.perfect_depth(rays);
      const NoiseSynthesis noise(NoiseSpectrum::parametric(2 * camera.height, 2 * camera.width, sigma, length, white),
                                 true);
      const NoiseSynthesis fixed(
          NoiseSpectrum::parametric(2 * camera.height, 2 * camera.width, std::max(fixed_sigma, 1e-9), 1.5, 0), true);
      cv::Mat pattern, field;
      fixed.synthesise(RandomStream(seed).child("fixed"), pattern);
      for (int number = 0; number < frames; ++number) {
        noise.synthesise(RandomStream(seed).child(static_cast<std::uint64_t>(number)), field);
        Frame frame;
        frame.camera = camera;
        frame.depth_scale_mm = step;
        frame.depth_mm = perfect.clone();
        frame.reason = cv::Mat::zeros(perfect.size(), CV_8U);
        for (int row = 0; row < perfect.rows; ++row)
          for (int col = 0; col < perfect.cols; ++col) {
            const double x = 2.0 * col / perfect.cols - 1, y = 2.0 * row / perfect.rows - 1;
            const double z = perfect.at<float>(row, col) + field.at<float>(row, col) +
                             (fixed_sigma > 0 ? pattern.at<float>(row, col) : 0.f) + bend_mm * (x * x + x * y * y);
            frame.depth_mm.at<float>(row, col) = static_cast<float>(step * std::nearbyint(z / step));
          }
        sink(frame, number);
      }
    };
  }

  FirstLook look(const std::string& key) const {
    PlaneWorld one = *this;
    one.frames = 1;
    FirstLook result;
    one.stream()([&](const Frame& frame, int) {
      result = look_at(key, key, frame, frames, cv::Mat(frame.depth_mm.size(), CV_8U, cv::Scalar(255)));
    });
    return result;
  }

  CaptureNoise measure(const std::string& key, int drop_order = 1, int max_lag = 24) const {
    PlaneNoiseOptions options;
    options.max_lag_px = max_lag;
    options.drop_order = drop_order;
    return measure_noise(look(key), stream(), false, options);
  }
};

TEST(LowFrequencies, PureNoiseLosesOnlyThePlane) {
  int dropped_more = 0;
  for (int seed = 0; seed < 40; ++seed) {
    PlaneWorld world;
    world.seed = 100 + seed;
    const FirstLook look = world.look("train/1");
    dropped_more += choose_drop_order({look.order_powers}, {look.plane.rms_z_mm}).drop_order > 1;
  }
  // The level is 1 % over the orders; 4 of 40 would be a chance of 1e-4.
  EXPECT_LT(dropped_more, 4);
}

TEST(LowFrequencies, AShapeOfOrderThreeIsDropped) {
  PlaneWorld world;
  world.bend_mm = 0.3;
  const FirstLook look = world.look("train/1");
  const auto low = choose_drop_order({look.order_powers}, {look.plane.rms_z_mm});
  EXPECT_GE(low.drop_order, 3);
  EXPECT_LE(low.drop_order, 4);
  EXPECT_TRUE(low.plateau_found);
  EXPECT_NE(low.reason.find("orders up to"), std::string::npos);
}

TEST(PlaneNoise, SplitsFixedPatternFromTemporalNoise) {
  PlaneWorld world;
  world.fixed_sigma = 0.2;
  world.frames = 5;
  const CaptureNoise noise = world.measure("train/1");
  ASSERT_TRUE(noise.temporal.has_value());
  const double rounding = 0.02 * 0.02 / 12;
  const double se = std::sqrt(2 / noise.temporal->effective_pixels());
  EXPECT_NEAR(noise.temporal->variance_mm2() / (0.0625 + rounding), 1, 5 * se);
  // The pattern is one draw of some 240 * 180 / (4 pi 1.5^2) = 1500 independent values.
  EXPECT_NEAR(noise.fixed_variance_mm2 / 0.04, 1, 5 * std::sqrt(2 / 1500.0));
  EXPECT_NEAR(noise.step_mm, 0.02, 1e-9);
  ASSERT_TRUE(noise.memory.has_value());
  EXPECT_LT(std::abs(*noise.memory), 0.03);
}

TEST(PlaneNoise, OneFrameIsAnUpperBoundAndSaysSo) {
  PlaneWorld world;
  world.fixed_sigma = 0.2;
  world.frames = 1;
  const CaptureNoise noise = world.measure("train/1");
  EXPECT_FALSE(noise.temporal.has_value());
  EXPECT_NEAR(noise.single.variance_mm2(), 0.1025, 0.1025 * 0.12);
  ASSERT_FALSE(noise.remarks.empty());
  EXPECT_NE(noise.remarks[0].find("upper bound"), std::string::npos);
}

TEST(PlaneNoise, CoarseStepsAreFoundAndDoubted) {
  PlaneWorld world;
  world.step = 1;
  const CaptureNoise noise = world.measure("train/1");
  EXPECT_EQ(noise.step_mm, 1);
  bool doubted = false;
  for (const auto& remark : noise.remarks) doubted |= remark.find("storage step") != std::string::npos;
  EXPECT_TRUE(doubted);
}

TEST(PlaneNoise, BrokenFramesAreNamed) {
  const PlaneWorld world;
  const FirstLook look = world.look("train/7");
  const FrameStream other_camera = [&](const FrameSink& sink) {
    world.stream()([&](const Frame& frame, int number) {
      Frame changed = frame;
      if (number == 2) changed.camera.fx *= 1.01;
      sink(changed, number);
    });
  };
  try {
    measure_noise(look, other_camera, false, {});
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("train/7, frame 2"), std::string::npos) << error.what();
  }
  EXPECT_THROW(measure_noise(look, [](const FrameSink&) {}, false, {}), Error);
}

TEST(ParametricNoise, RecoversItsOwnForm) {
  PlaneWorld world;
  world.length = 1.3;
  world.white = 0.2;
  world.frames = 6;
  const auto fit = fit_parametric(*world.measure("train/1").temporal);
  EXPECT_NEAR(fit.sigma_mm, 0.25, 0.01);
  // Rounding adds a white variance of 0.05 % of the whole.
  EXPECT_NEAR(fit.correlation_length_px, 1.3, 0.05);
  EXPECT_NEAR(fit.white_share, 0.2, 0.02);
  EXPECT_LT(fit.misfit, 3);
  EXPECT_LT(fit.correlation_length_ci95[0], 1.3);
  EXPECT_GT(fit.correlation_length_ci95[1], 1.3);
}

std::vector<CaptureNoise> campaign(double exponent) {
  std::vector<CaptureNoise> captures;
  for (double distance : {600.0, 700.0, 800.0, 900.0, 1000.0}) {
    PlaneWorld world;
    world.distance_mm = distance;
    world.seed = static_cast<std::uint64_t>(distance);
    world.sigma = 0.25 * std::pow(distance / 800, exponent);
    world.frames = 3;
    captures.push_back(world.measure("train/" + std::to_string(captures.size() + 1)));
  }
  return captures;
}

TEST(NoiseFit, FindsHowNoiseGoesWithDistance) {
  const FittedNoise fit = fit_noise(campaign(2), {}, true);
  EXPECT_NEAR(fit.law.exponent, 2, std::max(0.1, 4 * fit.law.exponent_se));
  EXPECT_NEAR(fit.sigma_mm, 0.25, 0.01);
  EXPECT_NEAR(fit.anchor_mm, 800, 15);
  bool told = false;
  for (const auto& remark : fit.remarks) told |= remark.find("axial_noise") != std::string::npos;
  EXPECT_TRUE(told);
  EXPECT_NEAR(fit.spectrum().variance_mm2(), fit.sigma_mm * fit.sigma_mm, 1e-6);
}

TEST(NoiseFit, JudgesASensorOfTheSameNoiseAsGoodAndOthersAsBad) {
  const FittedNoise fit = fit_noise(campaign(0), {}, true);
  PlaneWorld world;
  world.distance_mm = 750;
  world.seed = 4711;
  const CaptureNoise measured = world.measure("test/1");
  PlaneWorld twin = world;
  twin.seed = 99;
  const NoiseJudgement good = judge_noise(fit, measured, twin.measure("test/1"));
  EXPECT_TRUE(good.passed()) << noise_json(good).dump(1);
  EXPECT_LT(good.white_p, 1e-6);
  EXPECT_FALSE(good.in_sample);

  PlaneWorld strawman = twin;
  strawman.white = 1;
  const NoiseJudgement white = judge_noise(fit, measured, strawman.measure("test/1"));
  EXPECT_TRUE(white.sigma_ok);
  EXPECT_FALSE(white.spectrum_ok);
  EXPECT_FALSE(white.length_ok);

  PlaneWorld loud = twin;
  loud.sigma *= 1.2;
  const NoiseJudgement louder = judge_noise(fit, measured, loud.measure("test/1"));
  EXPECT_FALSE(louder.sigma_ok);
  ASSERT_FALSE(louder.why.empty());
}

TEST(NoiseFit, NeedsACapture) { EXPECT_THROW(fit_noise({}, {}, true), Error); }

}  // namespace
}  // namespace binrig
