#include "compare/value_steps.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace binrig {
namespace {

constexpr double focal_baseline = 45000;  // px mm
constexpr int most = 4;

Frame frame_of(const cv::Mat_<float>& depth_mm, double storage_mm = 0) {
  Frame frame;
  frame.depth_mm = depth_mm;
  frame.depth_scale_mm = storage_mm;
  return frame;
}

/// Flat targets, hardly tilted, at the given distances; `sensor` turns a true depth into a recorded one.
template <class Sensor>
ValueSteps seen(const std::vector<double>& distances_mm, double noise_mm, Sensor sensor, unsigned seed = 7,
                double storage_mm = 0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, noise_mm);
  ValueSteps steps;
  for (const double z : distances_mm) {
    cv::Mat_<float> depth_mm(96, 128);
    for (int row = 0; row < depth_mm.rows; ++row)
      for (int col = 0; col < depth_mm.cols; ++col)
        depth_mm(row, col) = static_cast<float>(sensor(z + 0.01 * (col - 64) + noise(random)));
    steps.add(frame_of(depth_mm, storage_mm), focal_baseline);
  }
  return steps;
}

ValueSteps usual(const std::vector<double>& distances_mm, double noise_mm = 0.25) {
  return seen(
      distances_mm, noise_mm, [](double z) { return z; }, 8);
}

/// What was read, each with its uncertainty, which the truth is to be within, and far within.
std::vector<double> values_of(const std::vector<ReadStep>& steps) {
  std::vector<double> values;
  for (const ReadStep& step : steps) values.push_back(step.value);
  return values;
}
bool has(const std::vector<ReadStep>& steps, double step) {
  return std::ranges::any_of(
      steps, [&](const ReadStep& read) { return std::abs(read.value - step) < 0.2 * read.uncertainty; });
}

double rounded(double value, double step) { return step * std::round(value / step); }

const std::vector<double> near_each_other{795.3, 798.1, 801.4, 803.2, 806.9, 809.7},
    apart{520, 610, 733, 802, 911, 1040};

TEST(ValueSteps, DepthThatIsRounded) {
  for (const double step : {0.31, 1.27, 3.9, 7.2})
    for (const auto& distances : {near_each_other, apart}) {
      const auto found =
          seen(distances, 0.25, [&](double z) { return rounded(z, step); }).depth_mm(0.1, 20, most, usual(distances));
      // Half a bin of the histogram, 0.005 mm, at the furthest target.
      const auto right = [&](double value) { return std::abs(value / step - 1) < 0.005 / distances.back(); };
      EXPECT_TRUE(std::ranges::any_of(values_of(found), right))
          << step << " mm, found " << testing::PrintToString(values_of(found));
      EXPECT_TRUE(has(found, step)) << step << " mm";
      for (const ReadStep& read : found) {
        EXPECT_TRUE(!right(read.value) || read.exact) << step << " mm";
      }
    }
}

TEST(ValueSteps, AStepThatIsDisturbedAfterwardsIsNotExact) {
  std::mt19937 random(5);
  std::normal_distribution<double> later(0, 0.1);  // mm; the modulus of the line is exp(-(2 pi 0.1 / 0.8)^2 / 2) = 0.73
  const auto found = seen(apart, 0.25, [&](double z) {
                       return rounded(z, 0.8) + later(random);
                     }).depth_mm(0.1, 20, most, usual(apart));
  ASSERT_TRUE(has(found, 0.8));
  EXPECT_TRUE(std::ranges::none_of(found, &ReadStep::exact));
}

TEST(ValueSteps, AStepHardlyCoarserThanThatOfStorage) {
  constexpr double storage = 0.1;
  const auto stored = [&](double z) { return rounded(z, storage); };
  const std::vector<double> distances{181, 196, 204, 213, 221, 262};
  const ValueSteps plain = seen(distances, 0.25, stored, 8, storage);
  for (const double step : {0.125, 0.15, 0.17}) {
    const auto found = seen(
                           distances, 0.25, [&](double z) { return stored(rounded(z, step)); }, 7, storage)
                           .depth_mm(0.02, 20, most, plain);
    const auto near = [&](double value) { return std::abs(value / step - 1) < 0.002; };
    EXPECT_TRUE(std::ranges::any_of(values_of(found), near))
        << step << " mm, found " << testing::PrintToString(values_of(found));
    for (const ReadStep& read : found) EXPECT_GT(read.value, storage) << "finer than what is stored";
  }
  EXPECT_TRUE(plain.depth_mm(0.02, 20, most, plain).empty());
}

TEST(ValueSteps, DisparityThatIsRoundedBeforeDepthIsDisturbedAndStored) {
  std::mt19937 random(3);
  std::normal_distribution<double> later(0, 0.1);
  for (const double step : {0.0417, 0.125, 0.3})
    for (const auto& distances : {near_each_other, apart}) {
      const auto found = seen(distances, 0.25, [&](double z) {
                           return rounded(focal_baseline / rounded(focal_baseline / z, step) + later(random), 0.05);
                         }).disparity_px(1.0 / 128, 1, most, usual(distances));
      const auto right = [&](double value) { return std::abs(value / step - 1) < 3e-4; };
      EXPECT_TRUE(std::ranges::any_of(values_of(found), right))
          << step << " px, found " << testing::PrintToString(values_of(found));
      EXPECT_TRUE(has(found, step)) << step << " px";
    }
}

TEST(ValueSteps, DisparitiesOfALongLens) {
  constexpr double long_lens = 230000;  // 210 to 440 px
  ValueSteps steps, usual;
  for (const double z : apart) {
    cv::Mat_<float> recorded(96, 128), unrounded(96, 128);
    for (int i = 0; i < 96 * 128; ++i) {
      unrounded(i / 128, i % 128) = static_cast<float>(z + 1e-3 * i);
      recorded(i / 128, i % 128) =
          static_cast<float>(long_lens / rounded(long_lens / unrounded(i / 128, i % 128), 0.0625));
    }
    steps.add(frame_of(recorded), long_lens);
    usual.add(frame_of(unrounded), long_lens);
  }
  const auto found = steps.disparity_px(1.0 / 128, 1, most, usual);
  ASSERT_FALSE(found.empty());
  EXPECT_NEAR(found.front().value, 0.0625, 0.0625 * 1e-4);
  EXPECT_TRUE(has(found, 0.0625));
  // A step more or less in the 210 to 440 px of the targets turns that by 1/3500 .. 1/7000.
  EXPECT_LT(found.front().uncertainty / 0.0625, 1.0 / 3500);
}

TEST(ValueSteps, AnOffsetOfAllStepsMovesNothing) {
  constexpr double step = 1.27;
  const auto found =
      seen(apart, 0.25, [&](double z) { return rounded(z, step) + 0.4; }).depth_mm(0.1, 20, most, usual(apart));
  ASSERT_FALSE(found.empty());
  EXPECT_NEAR(found.front().value, step,
              0.01 * step * step);  // a hundredth of a line's width, which is step^2 / (100 mm) at most
}

TEST(ValueSteps, NothingStandsOutOfValuesThatAreNotRounded) {
  EXPECT_TRUE(seen(apart, 3, [](double z) { return z; }).depth_mm(0.1, 2, most, usual(apart, 3)).empty());
}

TEST(ValueSteps, AStepThatIsUsualIsNotListed) {
  const auto stored = [](double z) { return rounded(z, 0.5); };
  EXPECT_FALSE(seen(apart, 0.25, stored).depth_mm(0.3, 2, most, usual(apart)).empty());
  EXPECT_TRUE(seen(apart, 0.25, stored).depth_mm(0.3, 2, most, seen(apart, 0.25, stored, 8)).empty());
}

TEST(ValueSteps, NothingIsReadOffNothing) {
  EXPECT_TRUE(ValueSteps().depth_mm(0.1, 20, most, ValueSteps()).empty());
  EXPECT_TRUE(ValueSteps().disparity_px(0.01, 1, most, ValueSteps()).empty());
}

}  // namespace
}  // namespace binrig
