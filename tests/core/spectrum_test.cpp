#include "core/spectrum.h"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <thread>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"

namespace binrig {
namespace {

cv::Mat random_image(int rows, int cols, std::uint64_t key) {
  cv::Mat image(rows, cols, CV_32F);
  RandomStream(key).fill_normal(image);
  return image;
}

class Fft2Sizes : public testing::TestWithParam<std::pair<int, int>> {};

TEST_P(Fft2Sizes, InverseOfForwardIsTheImageTimesItsPixels) {
  const auto [rows, cols] = GetParam();
  const cv::Mat image = random_image(rows, cols, 3);
  const Fft2 fft(rows, cols);
  std::vector<std::complex<float>> spectrum;
  fft.forward(image, spectrum);
  cv::Mat back;
  fft.inverse(spectrum, back);
  // Single precision: the DFT's error grows with the logarithm of the size; values are of order 4.
  EXPECT_LT(cv::norm(back / (rows * cols), image, cv::NORM_INF), 2e-5);
}

TEST_P(Fft2Sizes, AgreesWithTheDefiningSum) {
  const auto [rows, cols] = GetParam();
  // The defining sum is slow: of a large spectrum only some coefficients are looked at.
  const int step = rows * cols > 2000 ? 31 : 1;
  const cv::Mat image = random_image(rows, cols, 4);
  std::vector<std::complex<float>> spectrum;
  Fft2(rows, cols).forward(image, spectrum);
  for (int ky = 0; ky < rows; ky += step) {
    for (int kx = 0; kx <= cols / 2; kx += step) {
      std::complex<double> sum = 0;
      for (int y = 0; y < rows; ++y)
        for (int x = 0; x < cols; ++x)
          sum += static_cast<double>(image.at<float>(y, x)) *
                 std::polar(1.0, -2 * std::numbers::pi *
                                     (static_cast<double>(ky) * y / rows + static_cast<double>(kx) * x / cols));
      EXPECT_NEAR(std::abs(std::complex<double>(spectrum[ky * (cols / 2 + 1) + kx]) - sum), 0, 1e-4 * rows);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(EvenOddAndPrime, Fft2Sizes,
                         testing::Values(std::pair{1, 1}, std::pair{1, 8}, std::pair{8, 6}, std::pair{7, 9},
                                         std::pair{13, 10}, std::pair{96, 127}, std::pair{240, 320}));

TEST(Fft2, TakesViewsIntoLargerImages) {
  const cv::Mat image = random_image(20, 31, 5);
  const cv::Mat view = image(cv::Rect(3, 2, 15, 11));
  std::vector<std::complex<float>> of_view, of_copy;
  Fft2(11, 15).forward(view, of_view);
  Fft2(11, 15).forward(view.clone(), of_copy);
  EXPECT_EQ(of_view, of_copy);
}

TEST(Fft2, WritesWhereTheCallerHasTheImageHoweverItLies) {
  constexpr int rows = 6, cols = 10;
  const Fft2 fft(rows, cols);
  const RandomStream stream(3);
  for (int offset = 0; offset < 9; ++offset) {  // of which at most every fourth is where FFTW would have it
    std::vector<float> array(offset + rows * cols + 1, 77.f);
    for (int i = 0; i < rows * cols; ++i) array[offset + i] = static_cast<float>(stream.normal(i));
    const std::vector<float> before = array;
    cv::Mat image(rows, cols, CV_32F, array.data() + offset);
    std::vector<std::complex<float>> spectrum;
    fft.forward(image, spectrum);
    std::fill(array.begin() + offset, array.end() - 1, 0.f);
    fft.inverse(spectrum, image);
    for (int i = 0; i < rows * cols; ++i)
      EXPECT_NEAR(array[offset + i] / (rows * cols), before[offset + i], 1e-5) << offset;
    EXPECT_EQ(array.back(), 77.f);
  }
  cv::Mat large(rows + 2, cols + 3, CV_32F, cv::Scalar(5)), view = large(cv::Rect(1, 1, cols, rows));
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(rows) * fft.half_cols());
  fft.inverse(spectrum, view);
  EXPECT_EQ(cv::countNonZero(large), static_cast<int>(large.total()) - rows * cols);
}

TEST(Fft2, ManyThreadsGetTheSameNumbers) {
  std::vector<std::vector<std::complex<float>>> results(8);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < results.size(); ++i)
    threads.emplace_back([&, i] {
      for (int n = 20; n < 40; ++n) Fft2(n, n + 1).forward(random_image(n, n + 1, 6), results[i]);
    });
  for (auto& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_EQ(result, results.front());
}

TEST(Fft2, RefusesOtherShapes) {
  std::vector<std::complex<float>> spectrum(3);
  cv::Mat image;
  EXPECT_THROW(Fft2(4, 4).forward(random_image(4, 5, 1), spectrum), Error);
  EXPECT_THROW(Fft2(4, 4).inverse(spectrum, image), Error);
  EXPECT_THROW(Fft2(0, 4), Error);
}

TEST(NoiseSpectrum, ParametricHasTheVarianceAskedFor) {
  for (auto [rows, cols] : {std::pair{48, 64}, std::pair{33, 47}})
    EXPECT_NEAR(NoiseSpectrum::parametric(rows, cols, 0.3, 2.0, 0.1).variance_mm2(), 0.09, 1e-12);
  // White share 1 is flat.
  double low = 0, high = 0;
  cv::minMaxLoc(NoiseSpectrum::parametric(48, 64, 0.3, 2.0, 1.0).psd(), &low, &high);
  EXPECT_DOUBLE_EQ(low, high);
}

TEST(NoiseSpectrum, ParametricIsTheFormula) {
  const auto spectrum = NoiseSpectrum::parametric(96, 128, 1.0, 1.5, 0.2);
  // S(f) - w is proportional to exp(-(2 pi L f)^2).
  const auto g = [&](double f) { return spectrum.at(f, 0) - 0.2; };
  for (int k : {4, 8, 16}) {
    const double f = k / 128.0, a = 2 * std::numbers::pi * 1.5 * f;
    EXPECT_NEAR(g(f) / g(0), std::exp(-a * a), 1e-9);
  }
}

TEST(NoiseSpectrum, ResamplingKeepsTheVarianceAndTheShape) {
  const auto spectrum = NoiseSpectrum::parametric(96, 128, 0.25, 1.2, 0.15);
  for (auto [rows, cols] : {std::pair{192, 256}, std::pair{48, 64}, std::pair{77, 131}, std::pair{96, 128}}) {
    const auto other = spectrum.resampled(rows, cols);
    EXPECT_NEAR(other.variance_mm2(), spectrum.variance_mm2(), 1e-12);
    const auto truth = NoiseSpectrum::parametric(rows, cols, 0.25, 1.2, 0.15);
    // Averaging over a cell of 1/48 px bends a Gaussian of width 1/(2 pi 1.2) px by less than its second derivative
    // times the cell's variance, 2 (2 pi 1.2)^2 / (12 * 48^2) = 0.4 %, twice (both axes) and with the interpolation's.
    EXPECT_LT(cv::norm(other.psd(), truth.psd(), cv::NORM_INF), 0.015 * truth.psd().at<double>(0, 0));
  }
}

TEST(NoiseSpectrum, ResamplingLosesNoNarrowRidge) {
  cv::Mat psd = cv::Mat::zeros(64, 33, CV_64F);
  psd.row(3) = 5.0;  // lies between the frequencies of a grid with 32 rows
  psd.row(61) = 5.0;
  const NoiseSpectrum spectrum(psd, 64);
  EXPECT_NEAR(spectrum.resampled(32, 32).variance_mm2(), spectrum.variance_mm2(), 1e-12);
  EXPECT_NEAR(spectrum.resampled(200, 150).variance_mm2(), spectrum.variance_mm2(), 1e-12);
}

TEST(NoiseSpectrum, RadialFollowsTheRings) {
  const auto spectrum = NoiseSpectrum::parametric(256, 256, 1.0, 1.0, 0.0);
  const auto radial = spectrum.radial(32);
  ASSERT_EQ(radial.size(), 32u);
  for (int k = 1; k < 32; ++k) {
    EXPECT_LT(radial[k], radial[k - 1]);
    EXPECT_LT(radial[k], spectrum.at(k / 64.0, 0) * 1.0001);
    EXPECT_GT(radial[k], spectrum.at((k + 1) / 64.0, 0) * 0.9999);
  }
  // More rings than the grid has frequencies: still a number in each, between its neighbours.
  for (double value : NoiseSpectrum::parametric(8, 8, 1.0, 0.5, 0.3).radial(40)) EXPECT_GT(value, 0);
}

TEST(NoiseSpectrum, RefusesWhatIsNoPower) {
  EXPECT_THROW(NoiseSpectrum(cv::Mat(4, 3, CV_64F, cv::Scalar(-1)), 4), Error);
  EXPECT_THROW(NoiseSpectrum(cv::Mat(4, 3, CV_64F, cv::Scalar(std::nan(""))), 4), Error);
  EXPECT_THROW(NoiseSpectrum(cv::Mat(4, 3, CV_64F, cv::Scalar(1)), 8), Error);
  EXPECT_THROW(NoiseSpectrum(cv::Mat(4, 3, CV_64F, cv::Scalar(0)), 4).scaled_to(0.1), Error);
}

class SpectrumFile : public testing::Test {
 protected:
  void SetUp() override {
    folder = std::filesystem::temp_directory_path() /
             ("binrig_spectrum_" + std::to_string(std::hash<std::thread::id>{}(std::this_thread::get_id())) +
              testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder);
  }
  void TearDown() override { std::filesystem::remove_all(folder); }
  std::string file(const std::string& name) const { return (folder / name).string(); }
  std::filesystem::path folder;
};

TEST_F(SpectrumFile, RoundTrips) {
  const auto spectrum = NoiseSpectrum::parametric(31, 44, 0.2, 1.0, 0.1);
  spectrum.write(file("s.json"), "plane \"board\", 40 frames");
  const auto back = NoiseSpectrum::read(file("s.json"));
  EXPECT_EQ(back.provenance, "plane \"board\", 40 frames");
  EXPECT_EQ(back.cols(), 44);
  cv::Mat relative;
  cv::divide(cv::abs(back.psd() - spectrum.psd()), spectrum.psd(), relative);
  double worst = 0;
  cv::minMaxLoc(relative, nullptr, &worst);
  EXPECT_LT(worst, 1e-6);  // seven digits
}

TEST_F(SpectrumFile, BrokenOnesAreNamed) {
  const auto message = [&](const std::string& text) -> std::string {
    std::ofstream(file("s.json")) << text;
    try {
      NoiseSpectrum::read(file("s.json"));
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  const std::string good = R"({"rows": 2, "cols": 2, "psd_mm2_px2": [[1, 1], [1, 1]]})";
  EXPECT_EQ(message(good), "");
  for (const char* bad : {"", "{}", R"({"rows": 2, "cols": 2, "psd_mm2_px2": [[1, 1]]})",
                          R"({"rows": 2, "cols": 2, "psd_mm2_px2": [[1, 1], [1]]})",
                          R"({"rows": 2, "cols": 2, "psd_mm2_px2": [[1, 1], [1, -1]]})",
                          R"({"rows": 2, "cols": 2, "psd_mm2_px2": [[1, 1], [1, null]]})"})
    EXPECT_NE(message(bad).find("s.json"), std::string::npos) << bad;
  EXPECT_THROW(NoiseSpectrum::read(file("absent.json")), Error);
}

class Synthesis : public testing::TestWithParam<bool> {};

TEST_P(Synthesis, SameStreamSameBytesAndTheMeanScattersOnlyWithDrawnMagnitudes) {
  const auto spectrum = NoiseSpectrum::parametric(48, 64, 0.3, 1.0, 0.1);
  const NoiseSynthesis synthesis(spectrum, GetParam());
  cv::Mat a, b, c;
  synthesis.synthesise(RandomStream(7), a);
  synthesis.synthesise(RandomStream(7), b);
  synthesis.synthesise(RandomStream(8), c);
  EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(a, c, cv::NORM_INF), 0.1);
  // The variance of a mean over N pixels is S(0) / N.
  const double scatter = std::sqrt(spectrum.psd().at<double>(0, 0) / (48 * 64));
  double square = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    synthesis.synthesise(RandomStream(seed), c);
    square += std::pow(cv::mean(c)[0], 2) / 200;
  }
  if (GetParam())
    EXPECT_NEAR(std::sqrt(square), scatter, 5 * scatter / std::sqrt(2 * 200.0));
  else
    EXPECT_NEAR(std::sqrt(square), 0, 1e-6);
}

TEST_P(Synthesis, PeriodogramOfManyFieldsIsTheSpectrum) {
  // Even and odd sizes: the columns that mirror onto themselves are where a wrong factor would hide.
  for (auto [rows, cols] : {std::pair{16, 24}, std::pair{15, 21}}) {
    const auto spectrum = NoiseSpectrum::parametric(rows, cols, 0.3, 0.8, 0.2);
    const NoiseSynthesis synthesis(spectrum, GetParam());
    const Fft2 fft(rows, cols);
    const int fields = 4000;
    cv::Mat power = cv::Mat::zeros(rows, cols / 2 + 1, CV_64F);
    cv::Mat noise;
    std::vector<std::complex<float>> transform;
    for (int i = 0; i < fields; ++i) {
      synthesis.synthesise(RandomStream(100 + i), noise);
      fft.forward(noise, transform);
      for (int k = 0; k < power.rows * power.cols; ++k)
        power.at<double>(k / power.cols, k % power.cols) += std::norm(transform[k]) / (rows * cols) / fields;
    }
    for (int row = 0; row < power.rows; ++row) {
      for (int col = 0; col < power.cols; ++col) {
        if (row == 0 && col == 0) continue;
        // Fixed magnitudes are exact. Drawn ones scatter by 1/sqrt(fields), by sqrt(2/fields) where the coefficient is
        // real: 2.2 %; five of those cover some 600 comparisons.
        const double tolerance = GetParam() ? 5 * std::sqrt(2.0 / fields) : 1e-4;
        EXPECT_NEAR(power.at<double>(row, col) / spectrum.psd().at<double>(row, col), 1, tolerance)
            << row << " " << col << " of " << rows << " x " << cols;
      }
    }
  }
}

TEST_P(Synthesis, ValuesAreGaussian) {
  const NoiseSynthesis synthesis(NoiseSpectrum::parametric(128, 128, 1.0, 0.5, 0.5), GetParam());
  double second = 0, fourth = 0;
  cv::Mat noise;
  const int fields = 40;
  for (int i = 0; i < fields; ++i) {
    synthesis.synthesise(RandomStream(i), noise);
    for (float value : cv::Mat_<float>(noise)) {
      second += std::pow(value, 2);
      fourth += std::pow(value, 4);
    }
  }
  const double n = 128.0 * 128.0 * fields;
  // Kurtosis 3 with a standard error of sqrt(24 / n_effective); n/4 is a cautious effective number at L = 0.5.
  EXPECT_NEAR(fourth / n / std::pow(second / n, 2), 3, 5 * std::sqrt(24 * 4 / n));
}

INSTANTIATE_TEST_SUITE_P(FixedAndRayleigh, Synthesis, testing::Bool());

}  // namespace
}  // namespace binrig
