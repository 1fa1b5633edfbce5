// The statistics of residual images, on fields whose truth is known.
#include <cmath>

#include <gtest/gtest.h>

#include <functional>

#include <opencv2/core.hpp>

#include "compare/noise/autocovariance.h"
#include "compare/noise/gaussianity.h"
#include "compare/noise/spectrum_estimate.h"
#include "compare/noise/whiteness.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/random.h"
#include "core/spectrum.h"

namespace binrig {
namespace {

/// Exactly Gaussian fields with a known density. They are cut from a larger periodic field, so that opposite rims are
/// not neighbours.
class Fields {
 public:
  Fields(int side, double sigma, double correlation_length_px, double white_share)
      : side_(side),
        synthesis_(NoiseSpectrum::parametric(side + 32, side + 32, sigma, correlation_length_px, white_share), true) {}
  cv::Mat draw(std::uint64_t seed) const {
    cv::Mat field;
    synthesis_.synthesise(RandomStream(seed), field);
    return field(cv::Rect(0, 0, side_, side_)).clone();
  }

 private:
  int side_;
  NoiseSynthesis synthesis_;
};

cv::Mat holes(int side, double share, std::uint64_t seed) {
  const RandomStream stream(seed);
  cv::Mat valid(side, side, CV_8U);
  for (int i = 0; i < side * side; ++i) valid.at<std::uint8_t>(i / side, i % side) = stream.uniform(i) >= share;
  return valid;
}

double rejected_share(int runs, const std::function<TestResult(int)>& test) {
  std::vector<int> rejected(runs);
  parallel_for(runs, [&](int i) { rejected[i] = test(i).rejected(); });
  double sum = 0;
  for (const int r : rejected) sum += r;
  return sum / runs;
}

// 2,000 runs at level 0.05: a standard error of 0.49 %, so 1.5 % is three of them.
TEST(Gaussianity, KeepsItsLevelOnWhiteNoise) {
  const cv::Mat valid(64, 64, CV_8U, cv::Scalar(1));
  const double share = rejected_share(2000, [&](int i) {
    cv::Mat field(64, 64, CV_32F);
    RandomStream(1000 + i).fill_normal(field);
    return gaussianity(field, valid);
  });
  RecordProperty("rejected_percent", std::to_string(100 * share));
  EXPECT_NEAR(share, 0.05, 0.015);
}

TEST(Gaussianity, KeepsItsLevelOnNoiseCorrelatedOverThreePixelsWithHoles) {
  const Fields fields(160, 0.3, 1.5, 0);  // L = 1.5 px: correlation falls to 1/e at 3 px
  const double share =
      rejected_share(2000, [&](int i) { return gaussianity(fields.draw(5000 + i), holes(160, 0.1, 9000 + i)); });
  RecordProperty("rejected_percent", std::to_string(100 * share));
  EXPECT_NEAR(share, 0.05, 0.015);
}

// Student's t with 10 degrees of freedom has kurtosis 3 + 6 / (10 - 4) = 4.
TEST(Gaussianity, SeesHeavyTails) {
  int rejected = 0;
  for (int run = 0; run < 100; ++run) {
    const RandomStream stream(70000 + run);
    std::vector<float> values(20000);
    for (std::size_t i = 0; i < values.size(); ++i) {
      double chi = 0;
      for (int k = 0; k < 10; ++k) chi += std::pow(stream.normal(11 * i + k), 2);
      values[i] = static_cast<float>(stream.normal(11 * i + 10) / std::sqrt(chi / 10));
    }
    rejected += gaussianity(values).rejected();
  }
  EXPECT_GT(rejected, 95);
}

TEST(Gaussianity, SaysWhenThereIsTooLittleToGoBy) {
  EXPECT_FALSE(gaussianity(std::vector<float>(50, 1.f)).done);
  EXPECT_FALSE(gaussianity(std::vector<float>(5000, 1.f)).done);
}

TEST(SameDistribution, KeepsItsLevelAndSeesADifferentWidth) {
  const auto sample = [](std::uint64_t seed, int n, float scale) {
    cv::Mat image(1, n, CV_32F);
    RandomStream(seed).fill_normal(image);
    image = cv::Mat(image * scale);
    return std::vector<float>(image.begin<float>(), image.end<float>());
  };
  const double share = rejected_share(
      1000, [&](int i) { return same_distribution(sample(2 * i + 1, 3000, 1), sample(2 * i + 2, 5000, 1), false); });
  EXPECT_NEAR(share, 0.05, 0.021);  // three standard errors of 0.69 %
  EXPECT_LT(same_distribution(sample(1, 5000, 1), sample(2, 5000, 1.15f), false).p_value, 0.001);
  EXPECT_GT(same_distribution(sample(1, 5000, 1), sample(2, 5000, 1.15f), true).p_value, 0.001);
}

// Over many draws the estimate's mean must be the truth, with holes and without: the standard error of the mean is
// taken from the draws themselves.
TEST(Autocovariance, IsUnbiasedWhateverTheHoles) {
  const double sigma = 0.4, length = 1.5;
  const Fields fields(96, sigma, length, 0.3);
  for (const double share : {0.0, 0.1, 0.4}) {
    constexpr int runs = 60;
    for (const int lag : {0, 1, 3}) {
      double sum = 0, square = 0;
      for (int i = 0; i < runs; ++i) {
        Autocovariance estimate(12, 8);
        estimate.add(fields.draw(300 + i), holes(96, share, 40 + i));
        const double c = estimate.covariance().at<double>(12, 12 + lag);
        sum += c;
        square += c * c;
      }
      const double mean = sum / runs, error = std::sqrt((square / runs - mean * mean) / (runs - 1));
      // The transform of exp(-(2 pi L f)^2) is exp(-d^2 / (4 L^2)); the white share sits at lag 0 alone. The grid's
      // finite band changes it by less than 1e-4 of the variance at L = 1.5.
      const double truth = sigma * sigma * (0.7 * std::exp(-lag * lag / (4 * length * length)) + (lag == 0 ? 0.3 : 0));
      EXPECT_NEAR(mean, truth, 4 * error + 2e-4 * sigma * sigma) << "lag " << lag << ", holes " << share;
    }
  }
}

TEST(Autocovariance, KnowsHowWellItKnows) {
  // The jackknife's standard error of the variance against the spread of the estimate over 100 draws.
  const Fields fields(128, 1, 1, 0);
  const cv::Mat valid(128, 128, CV_8U, cv::Scalar(1));
  double sum = 0, square = 0, stated = 0;
  constexpr int runs = 100;
  for (int i = 0; i < runs; ++i) {
    Autocovariance estimate(8);
    estimate.add(fields.draw(i), valid);
    const auto variance =
        estimate.estimate([](const cv::Mat& c) { return std::vector<double>{c.at<double>(8, 8)}; })[0];
    sum += variance.value;
    square += variance.value * variance.value;
    stated += variance.standard_error / runs;
  }
  const double spread = std::sqrt(square / runs - std::pow(sum / runs, 2));
  // A spread from 100 draws is known to 7 %; the jackknife of 24 groups adds 15 % / sqrt(100).
  EXPECT_NEAR(stated / spread, 1, 0.25);
}

TEST(Spectrum, TheEstimateFollowsTheTruth) {
  const double sigma = 0.3;
  const NoiseSpectrum truth = NoiseSpectrum::parametric(64, 64, sigma, 1, 0.2);
  const Fields fields(256, sigma, 1, 0.2);
  Autocovariance estimate(32);
  for (int i = 0; i < 8; ++i) estimate.add(fields.draw(i), holes(256, 0.2, i));
  const auto measured = ring_spectrum(estimate);
  const auto expected = truth.radial(static_cast<int>(measured.frequency.size()));
  for (std::size_t i = 0; i < expected.size(); ++i) {
    // 6 % for the lag window's smoothing of a peak of width 1 / (2 pi L) = 0.16 cycles/px, and chance.
    EXPECT_NEAR(measured.density[i].value / expected[i], 1, 0.06 + 4 * measured.log_density[i].standard_error)
        << measured.frequency[i];
  }
  EXPECT_NEAR(spectral_density(estimate.covariance()).variance_mm2(), sigma * sigma, 0.03 * sigma * sigma);
}

TEST(Spectrum, EqualNoisesLieInTheirBandAndOthersDoNot) {
  const Fields soft(192, 0.3, 1.5, 0.1), hard(192, 0.3, 0, 1);
  const cv::Mat valid(192, 192, CV_8U, cv::Scalar(1));
  Autocovariance a(16), b(16), c(16);
  for (int i = 0; i < 4; ++i) {
    a.add(soft.draw(i), valid);
    b.add(soft.draw(100 + i), valid);
    c.add(hard.draw(200 + i), valid);
  }
  const auto same = compare_spectra(ring_spectrum(a), ring_spectrum(b));
  EXPECT_GE(same.share_inside, 0.75);
  EXPECT_GT(same.worst_p, 0.005);
  const auto other = compare_spectra(ring_spectrum(a), ring_spectrum(c));
  EXPECT_LT(other.share_inside, 0.4);
  EXPECT_LT(other.worst_p, 1e-6);
}

TEST(Whiteness, KeepsItsLevelAndRejectsTheCorrelated) {
  const double share = rejected_share(1000, [](int i) {
    cv::Mat field(96, 96, CV_32F);
    RandomStream(300 + i).fill_normal(field);
    Autocovariance estimate(8, 2);
    estimate.add(field, holes(96, 0.1, i));
    return whiteness(estimate);
  });
  EXPECT_NEAR(share, 0.05, 0.021);  // three standard errors of 0.69 %
  const Fields soft(96, 1, 0.4, 0.5);
  Autocovariance estimate(8, 2);
  estimate.add(soft.draw(1), holes(96, 0.1, 1));
  EXPECT_LT(whiteness(estimate).p_value, 1e-6);
}

TEST(CorrelationLength, IsTwiceL) {
  for (const double length : {1.0, 2.0, 3.0}) {
    const Fields fields(256, 1, length, 0);
    Autocovariance estimate(32);
    for (int i = 0; i < 4; ++i) estimate.add(fields.draw(i), cv::Mat(256, 256, CV_8U, cv::Scalar(1)));
    EXPECT_NEAR(correlation_length_px(estimate.covariance()), 2 * length, 0.1 * 2 * length) << length;
  }
}

TEST(Autocovariance, MisuseIsAnError) {
  EXPECT_THROW(Autocovariance(1), Error);
  Autocovariance estimate(8);
  EXPECT_THROW(estimate.add(cv::Mat(10, 10, CV_64F), cv::Mat(10, 10, CV_8U)), Error);
}

}  // namespace
}  // namespace binrig
