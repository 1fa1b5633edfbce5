#include <gtest/gtest.h>

#include <cmath>

#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "core/random.h"

namespace binrig {
namespace {

// Known answer of Philox-4x32-10 for key 0, counter 0 (the first two words, from the authors' test vectors:
// 6627e8d5 e169c58d bc57ac4c 9b00dbd8).
TEST(Random, GeneratorIsPhilox) { EXPECT_EQ(RandomStream(0).bits(0), 0x6627e8d5e169c58dull); }

struct Moments {
  double mean = 0, variance = 0, kurtosis = 0;
};

Moments moments(const cv::Mat& image) {
  Moments m;
  const double n = static_cast<double>(image.total());
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.cols; ++c) m.mean += image.at<float>(r, c) / n;
  }
  double fourth = 0;
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.cols; ++c) {
      const double d = image.at<float>(r, c) - m.mean;
      m.variance += d * d / n;
      fourth += d * d * d * d / n;
    }
  }
  m.kurtosis = fourth / (m.variance * m.variance);
  return m;
}

// n = 10^6 draws; each moment within 5 standard errors (1/sqrt n, sqrt(2/n), sqrt(24/n)).
TEST(Random, FilledNormalsHaveTheMomentsOfANormal) {
  cv::Mat image(1000, 1000, CV_32F);
  RandomStream(7).fill_normal(image);
  const Moments m = moments(image);
  EXPECT_NEAR(m.mean, 0, 5e-3);
  EXPECT_NEAR(m.variance, 1, 5 * std::sqrt(2e-6));
  EXPECT_NEAR(m.kurtosis, 3, 5 * std::sqrt(24e-6));
}

TEST(Random, FilledUniformsAreUniform) {
  cv::Mat image(999, 1001, CV_32F);
  RandomStream(8).fill_uniform(image);
  double low = 0, high = 0;
  cv::minMaxLoc(image, &low, &high);
  EXPECT_GE(low, 0);
  EXPECT_LT(high, 1);
  const Moments m = moments(image);
  EXPECT_NEAR(m.mean, 0.5, 5 * std::sqrt(1e-6 / 12));
  EXPECT_NEAR(m.variance, 1.0 / 12, 5 * std::sqrt(1e-6 / 180));
}

TEST(Random, SingleNormalsHaveUnitVariance) {
  const RandomStream stream(9);
  double sum = 0, squares = 0;
  const int n = 100000;
  for (int i = 0; i < n; ++i) {
    const double x = stream.normal(i);
    sum += x;
    squares += x * x;
  }
  EXPECT_NEAR(sum / n, 0, 5 / std::sqrt(n));
  EXPECT_NEAR(squares / n, 1, 5 * std::sqrt(2.0 / n));
}

// Neighbours in the image, rows, and streams of neighbouring keys are uncorrelated: |r| < 5/sqrt(n).
TEST(Random, NeighboursAndNeighbouringStreamsAreUncorrelated) {
  cv::Mat a(500, 501, CV_32F), b(500, 501, CV_32F);
  frame_stream(1, 2, 3, "noise").fill_normal(a);
  frame_stream(1, 2, 4, "noise").fill_normal(b);
  const auto correlation = [](const cv::Mat& x, const cv::Mat& y) { return x.dot(y) / static_cast<double>(x.total()); };
  const double bound = 5 / std::sqrt(500.0 * 501);
  EXPECT_LT(std::abs(correlation(a, b)), bound);
  EXPECT_LT(std::abs(correlation(a(cv::Rect(0, 0, 500, 500)).clone(), a(cv::Rect(1, 0, 500, 500)).clone())), bound);
  EXPECT_LT(std::abs(correlation(a(cv::Rect(0, 0, 500, 499)).clone(), a(cv::Rect(0, 1, 500, 499)).clone())), bound);
}

TEST(Random, EveryPartOfTheKeyCounts) {
  const std::uint64_t base = frame_stream(1, 2, 3, "a").key();
  EXPECT_NE(base, frame_stream(2, 2, 3, "a").key());
  EXPECT_NE(base, frame_stream(1, 3, 3, "a").key());
  EXPECT_NE(base, frame_stream(1, 2, 4, "a").key());
  EXPECT_NE(base, frame_stream(1, 2, -1, "a").key());
  EXPECT_NE(base, frame_stream(1, 2, 3, "b").key());
  EXPECT_NE(frame_stream(1, 2, 3, "a").key(), frame_stream(2, 1, 3, "a").key());
  EXPECT_NE(unit_stream(1, "a").key(), unit_stream(2, "a").key());
}

TEST(Random, ThreadsChangeNothing) {
  cv::Mat one(313, 217, CV_32F), many(313, 217, CV_32F);
  set_jobs(1);
  RandomStream(5).fill_normal(one);
  set_jobs(7);
  RandomStream(5).fill_normal(many);
  set_jobs(0);
  EXPECT_EQ(cv::norm(one, many, cv::NORM_INF), 0);
}

TEST(Parallel, EachItemOnceAndTheFirstErrorComesBack) {
  std::vector<int> seen(1000, 0);
  set_jobs(4);
  parallel_for(1000, [&](int i) { ++seen[i]; });
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), 1000);
  EXPECT_THROW(parallel_for(100, [](int i) { if (i == 50) throw std::runtime_error("fifty"); }), std::runtime_error);
  set_jobs(0);
}

}  // namespace
}  // namespace binrig
