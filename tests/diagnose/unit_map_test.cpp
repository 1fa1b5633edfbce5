#include "diagnose/unit_map.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core/mat.hpp>

#include "core/random.h"

namespace binrig {
namespace {

constexpr int rows = 12, cols = 16, cells = rows * cols, captures = 8;

/// Bias maps of eight captures, six to fit on.
Layout layout_of_maps() {
  Layout layout;
  for (int c = 0; c < captures; ++c) {
    layout.blocks.push_back({c, 0, layout.size, cells, rows, cols, c < 6});
    layout.size += cells;
    layout.train.push_back(c < 6);
  }
  layout.captures = captures;
  return layout;
}

std::vector<float> normals(int size, std::uint64_t key) {
  std::vector<float> v(size);
  cv::Mat row(1, size, CV_32F, v.data());
  RandomStream(key).fill_normal(row);
  return v;
}

/// The same map in every capture, with noise of unit standard deviation on top if `noise`.
StatVector recording(const std::vector<float>& map, float amplitude, std::uint64_t noise) {
  StatVector result(captures * cells, 0.f);
  if (noise) result = normals(captures * cells, noise);
  for (std::size_t i = 0; i < result.size(); ++i) result[i] += amplitude * map[i % cells];
  return result;
}

struct Stand {
  Layout layout = layout_of_maps();
  Rung rung;
  Stand() {
    std::vector<StatVector> simulations;
    for (std::uint64_t k = 1; k <= 40; ++k) simulations.push_back(normals(layout.size, k));
    rung.standard = Standard(layout, StatVector(layout.size, 0.f), simulations);
    for (const auto& s : simulations) rung.nulls.push_back(rung.standard.linear(s));
    rung.train = Metric(layout, Part::train, {});
    rung.test = Metric(layout, Part::test, {});
  }
  UnitMap learned() const {
    std::vector<StatVector> without, with;
    for (std::uint64_t k = 0; k < 4; ++k) {
      without.push_back(StatVector(layout.size, 0.f));
      with.push_back(recording(normals(cells, 1000 + k), 0.5f, 0));
    }
    return UnitMap(layout, rung, without, with);
  }
  Whitened rest(const StatVector& data) const {
    Whitened y = rung.standard.linear(data);
    compress(y);
    return y;
  }
};

TEST(UnitMap, AnotherUnitsMapIsExplainedOnCapturesHeldOut) {
  const Stand stand;
  const Whitened rest = stand.rest(recording(normals(cells, 5000), 0.5f, 6000));
  const UnitMap map = stand.learned();
  const auto gain = map.gain(rest, rest);
  // Per cell: six captures with loading 0.5 leave the map (variance 1) known to 1 - 1 / (1 + 6/4) = 0.6 of it, so that
  // each of the two captures held out gains 0.25 (2 * 0.6 - 0.6) = 0.15 a cell; 192 cells, 58 +- some 12.
  EXPECT_NEAR(gain.test, 58, 40);
  EXPECT_GT(gain.train, 40);
  EXPECT_TRUE(map.looks_random(rest));
}

TEST(UnitMap, NoiseThatIsNewInEveryCaptureIsNoMap) {
  const Stand stand;
  const UnitMap map = stand.learned();
  double test = 0;
  for (std::uint64_t k = 0; k < 10; ++k) {
    const Whitened rest = stand.rest(recording(std::vector<float>(cells, 0.f), 0, 7000 + k));
    const auto gain = map.gain(rest, rest);
    EXPECT_LT(gain.train, 10);
    test += gain.test;
  }
  EXPECT_LT(test / 10, 3);
}

TEST(UnitMap, AStepOrAWaveIsNoRandomMap) {
  const Stand stand;
  const UnitMap map = stand.learned();
  std::vector<float> step(cells), wave(cells);
  for (int i = 0; i < cells; ++i) {
    step[i] = i % cols + i / cols > 14 ? 1.f : -1.f;
    wave[i] = 1.4f * std::sin(0.9f * static_cast<float>(i % cols));
  }
  for (const auto& shape : {step, wave}) {
    const Whitened rest = stand.rest(recording(shape, 1.5f, 8000));
    EXPECT_GT(map.gain(rest, rest).test, 100);  // it is fixed in the image
    EXPECT_FALSE(map.looks_random(rest));
  }
}

TEST(UnitMap, ASpotIsNoScatterOfPixels) {
  // Units of which few cells stand out; then a recording in which as many stand out, but side by side.
  const Stand stand;
  std::vector<StatVector> without, with;
  const auto scattered = [](std::uint64_t unit) {
    std::vector<float> map(cells, 0.f);
    const RandomStream stream(unit);
    for (int k = 0; k < 9; ++k) map[static_cast<int>(stream.uniform(k) * cells)] = 3;
    return map;
  };
  for (std::uint64_t k = 0; k < 4; ++k) {
    without.push_back(StatVector(stand.layout.size, 0.f));
    with.push_back(recording(scattered(300 + k), 1, 0));
  }
  const UnitMap map(stand.layout, stand.rung, without, with);
  std::vector<float> spot(cells, 0.f);
  for (int r = 4; r < 7; ++r)
    for (int c = 6; c < 9; ++c) spot[r * cols + c] = 3;
  EXPECT_TRUE(map.looks_random(stand.rest(recording(scattered(400), 1, 9000))));
  EXPECT_FALSE(map.looks_random(stand.rest(recording(spot, 1, 9000))));
}

}  // namespace
}  // namespace binrig
