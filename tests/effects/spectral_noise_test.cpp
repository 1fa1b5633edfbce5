#include <cmath>
#include <filesystem>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/spectrum.h"
#include "sim/effect.h"

namespace binrig {
namespace {

struct NoiseSetup {
  EffectInstance instance;
  CaptureContext context;

  NoiseSetup(int width, int height, double sigma, double length, double white) {
    instance.effect = instance.id = "spectral_noise";
    instance.values["sigma"].value = sigma;
    instance.values["correlation_length"].value = length;
    instance.values["white_share"].value = white;
    context.camera = camera_from_field_of_view(width, height, 0.6);
    context.instance = "spectral_noise";
  }

  cv::Mat noise(int frame, float sigma_scale = 1) const {
    const auto run = find_effect("spectral_noise")->begin(instance, context);
    const int rows = context.camera.height, cols = context.camera.width;
    Layers layers;
    layers.depth_mm = cv::Mat(rows, cols, CV_32F, cv::Scalar(800));
    layers.sigma_scale = cv::Mat(rows, cols, CV_32F, cv::Scalar(sigma_scale));
    layers.noise_mm = cv::Mat::zeros(rows, cols, CV_32F);
    layers.reason = cv::Mat::zeros(rows, cols, CV_8U);
    run->apply(layers, Channels{}, {.number = frame, .time_s = 0});
    return layers.noise_mm;
  }
};

double deviation(const cv::Mat& image) {
  cv::Scalar mean, sigma;
  cv::meanStdDev(image, mean, sigma);
  return sigma[0];
}

TEST(SpectralNoise, HasTheStandardDeviationAskedFor) {
  NoiseSetup setup(320, 240, 0.3, 0.8, 0.1);
  // 76800 / (4 pi L^2) = 9500 independent pixels.
  EXPECT_NEAR(deviation(setup.noise(0)), 0.3, 5 * 0.3 / std::sqrt(2 * 9500.0));
  // Fixed magnitudes: exact but for the frequency 0, whose share of the variance stays out.
  setup.instance.options["magnitudes"] = "fixed";
  EXPECT_NEAR(deviation(setup.noise(0)), 0.3, 0.3 * 0.002);
  EXPECT_NEAR(deviation(setup.noise(0, 2.5f)), 0.75, 0.75 * 0.002);
}

TEST(SpectralNoise, NeutralChangesNothing) {
  const NoiseSetup setup(64, 48, 0, 0.8, 0.1);
  EXPECT_TRUE(find_effect("spectral_noise")->is_neutral(setup.instance));
  EXPECT_EQ(cv::norm(setup.noise(0), cv::NORM_INF), 0);
}

TEST(SpectralNoise, FramesDifferAndRepeat) {
  const NoiseSetup setup(64, 48, 0.3, 0.8, 0.1);
  EXPECT_EQ(cv::norm(setup.noise(0), setup.noise(0), cv::NORM_INF), 0);
  // Independent frames: the correlation of 3072 pixels with L = 0.8 px, some 400 independent ones, stays below 5/20.
  const cv::Mat a = setup.noise(0), b = setup.noise(1);
  EXPECT_LT(std::abs(a.dot(b)) / std::sqrt(a.dot(a) * b.dot(b)), 0.25);
}

TEST(SpectralNoise, WhiteShareOneIsWhite) {
  const cv::Mat noise = NoiseSetup(320, 240, 0.3, 3, 1).noise(0);
  const cv::Mat left = noise.colRange(0, 319), right = noise.colRange(1, 320);
  EXPECT_LT(std::abs(left.dot(right)) / noise.dot(noise), 5 / std::sqrt(320.0 * 240));
}

TEST(SpectralNoise, ACorrelatedFieldHasTheCorrelationOfItsFormula) {
  // g is a Gaussian of the frequency, so the autocorrelation is exp(-lag^2 / (4 L^2)): at 2 px and L = 2, e^-1/4.
  const cv::Mat noise = NoiseSetup(640, 480, 0.3, 2, 0).noise(0);
  const double correlation = noise.colRange(0, 638).dot(noise.colRange(2, 640)) / noise.dot(noise);
  // 307200 / (4 pi L^2) = 6100 independent pixels.
  EXPECT_NEAR(correlation, std::exp(-0.25), 5 * 0.3 / std::sqrt(6100.0));
}

TEST(SpectralNoise, DrawnMagnitudesScatterTheVariance) {
  NoiseSetup setup(64, 48, 0.3, 1, 0);
  double low = 1e9, high = 0;
  for (int frame = 0; frame < 20; ++frame) {
    low = std::min(low, deviation(setup.noise(frame)));
    high = std::max(high, deviation(setup.noise(frame)));
  }
  EXPECT_GT(high - low, 0.01);
}

TEST(SpectralNoise, AFileOfAnotherSizeKeepsItsCorrelationLength) {
  const auto path = std::filesystem::temp_directory_path() / "binrig_spectral_noise_test.json";
  NoiseSpectrum::parametric(240, 320, 1.0, 2.0, 0.0).write(path.string(), "test");
  NoiseSetup setup(640, 480, 0.4, 0, 0);
  setup.instance.options["spectrum"] = path.string();
  setup.instance.options["magnitudes"] = "fixed";
  const cv::Mat noise = setup.noise(0);
  std::filesystem::remove(path);
  EXPECT_NEAR(deviation(noise), 0.4, 0.4 * 0.01);
  const double correlation = noise.colRange(0, 638).dot(noise.colRange(2, 640)) / noise.dot(noise);
  EXPECT_NEAR(correlation, std::exp(-0.25), 5 * 0.3 / std::sqrt(6100.0));
}

TEST(SpectralNoise, AFileOfAnotherCameraIsRefusedWithTheModelsLine) {
  const auto path = std::filesystem::temp_directory_path() / "binrig_spectral_noise_other_camera.json";
  auto spectrum = NoiseSpectrum::parametric(64, 64, 1.0, 2.0, 0.0);
  spectrum.camera_width = 640;
  spectrum.camera_height = 480;
  spectrum.write(path.string(), "test");
  NoiseSetup same(640, 480, 0.4, 0, 0), other(320, 240, 0.4, 0, 0);
  same.instance.options["spectrum"] = other.instance.options["spectrum"] = path.string();
  other.instance.where = "model.yaml:9";
  EXPECT_NEAR(deviation(same.noise(0)), 0.4, 0.4 * 0.01);
  try {
    other.noise(0);
    FAIL() << "a spectrum of another camera went unnoticed";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("model.yaml:9"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("640 x 480"), std::string::npos) << error.what();
  }
  std::filesystem::remove(path);
}

TEST(SpectralNoise, AMissingOrBrokenFileIsNamedWithTheModelsLine) {
  NoiseSetup setup(64, 48, 0.4, 0, 0);
  setup.instance.options["spectrum"] = "absent.json";
  setup.instance.where = "model.yaml:7";
  setup.context.model_folder = "nowhere";
  try {
    setup.noise(0);
    FAIL() << "an absent file went unnoticed";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("model.yaml:7"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("nowhere/absent.json"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace binrig
