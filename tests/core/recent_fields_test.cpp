#include "core/recent_fields.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/coherent_noise.h"
#include "core/spectrum.h"

namespace binrig {
namespace {

TEST(RecentField, IsDrawnOnceForAKindAndAStream) {
  int drawn = 0;
  const auto field = [&](std::uint64_t kind, std::uint64_t key) {
    return recent_field(kind, RandomStream(key), [&](cv::Mat& to) { to = cv::Mat(2, 2, CV_32F, cv::Scalar(++drawn)); });
  };
  const std::uint64_t kind = hash_text("a kind of this test");
  EXPECT_EQ(field(kind, 1).data, field(kind, 1).data);
  EXPECT_EQ(drawn, 1);
  EXPECT_EQ(field(kind, 2).at<float>(0), 2);
  EXPECT_EQ(field(kind + 1, 1).at<float>(0), 3);
  EXPECT_EQ(field(kind, 1).at<float>(0), 1);
}

double difference(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() ? cv::norm(a, b, cv::NORM_INF) : 1e9;
}

TEST(RecentField, OfANoiseIsWhatWouldBeDrawnNow) {
  // Kinds that differ in one thing each, asked for from one stream: none may be taken for another.
  const RandomStream stream(11);
  std::vector<cv::Mat> fields;
  const auto add = [&](const cv::Mat& recent, const cv::Mat& fresh) {
    EXPECT_EQ(difference(recent, fresh), 0) << fields.size();
    for (const cv::Mat& other : fields) EXPECT_GT(difference(recent, other), 0) << fields.size();
    fields.push_back(recent);
  };
  struct Lattice {
    int rows, cols;
    double grid_px;
    LatticeWeight weight;
  };
  using enum LatticeWeight;
  for (const auto& [rows, cols, grid_px, weight] : std::initializer_list<Lattice>{
           {30, 40, 10, cubic}, {30, 40, 10, quintic}, {30, 40, 11, cubic}, {31, 40, 10, cubic}, {30, 41, 10, cubic}}) {
    const CoherentNoise noise(rows, cols, grid_px, weight);
    cv::Mat fresh;
    noise.draw(stream, fresh);
    add(noise.recent(stream), fresh);
  }
  struct Density {
    int rows, cols;
    double sigma_mm, length_px;
    bool rayleigh;
  };
  for (const auto& [rows, cols, sigma_mm, length_px, rayleigh] : std::initializer_list<Density>{
           {30, 40, 1, 2, true}, {30, 40, 1, 2, false}, {30, 40, 2, 2, true}, {30, 40, 1, 3, true}, {30, 42, 1, 2, true}}) {
    const NoiseSynthesis noise(NoiseSpectrum::parametric(rows, cols, sigma_mm, length_px, 0.1), rayleigh);
    cv::Mat fresh;
    noise.synthesise(stream, fresh);
    add(noise.recent(stream), fresh);
  }
}

}  // namespace
}  // namespace binrig
