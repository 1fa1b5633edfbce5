#include "diagnose/metric.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <Eigen/LU>

#include "core/random.h"
#include "diagnose/signatures.h"

namespace binrig {
namespace {

/// Two captures, one to fit on and one to hold out, with a bias map and a small segment each.
Layout small_layout() {
  Layout layout;
  const int bias = 0, shape = 5;
  for (int c = 0; c < 2; ++c) {
    layout.blocks.push_back({c, bias, layout.size, 12 * 16, 12, 16, c == 0});
    layout.size += 12 * 16;
    layout.blocks.push_back({c, shape, layout.size, 5, 1, 5, c == 0});
    layout.size += 5;
    layout.train.push_back(c == 0);
  }
  layout.captures = 2;
  return layout;
}

std::vector<float> normals(int size, std::uint64_t key) {
  std::vector<float> v(size);
  const RandomStream stream(key);
  for (int i = 0; i < size; ++i) v[i] = static_cast<float>(stream.normal(i));
  return v;
}

std::vector<StatVector> simulations(const Layout& layout, int count, float sigma, std::uint64_t key) {
  std::vector<StatVector> result;
  for (int k = 0; k < count; ++k) {
    result.push_back(normals(layout.size, key + k));
    for (float& v : result.back()) v = 3.f + sigma * v;
  }
  return result;
}

TEST(Standard, ItsOwnSimulationsHaveUnitVariance) {
  const Layout layout = small_layout();
  const Standard standard(layout, StatVector(layout.size, 0.f), simulations(layout, 60, 0.5f, 100));
  double sum = 0, count = 0;
  for (const auto& s : simulations(layout, 20, 0.5f, 900)) {
    const Whitened y = standard.linear(s);
    sum += dot(y, y);
    count += layout.size;
  }
  // 7880 numbers: 1.6 % from chance; the floors (0.02 of 0.5) and the mean of 60 add at most 2 %; the five-element
  // blocks are whitened with a correlation learned from 60 simulations.
  EXPECT_NEAR(sum / count, 1, 0.08);
}

/// With something smooth beside the noise: the same in 4 x 4 elements of a map, and in all of what is no map.
std::vector<StatVector> with_patches(const Layout& layout, std::vector<StatVector> recordings, float sigma,
                                     std::uint64_t key) {
  for (auto& recording : recordings)
    for (const Block& block : layout.blocks) {
      const auto dice = normals(block.size, key++);
      for (int i = 0; i < block.size; ++i)
        recording[block.offset + i] +=
            sigma * dice[block.rows > 1 ? i / block.cols / 4 * block.cols + i % block.cols / 4 : 0];
    }
  return recordings;
}

TEST(Standard, ItsLogDeterminantIsThatOfWhatItWhitensWith) {
  Layout layout = small_layout();
  StatVector measured(layout.size, 0.f);
  const int known = layout.blocks[3].size - 1;
  measured[layout.blocks[3].offset + 2] = std::numeric_limits<float>::quiet_NaN();
  const Standard standard(layout, measured, with_patches(layout, simulations(layout, 60, 0.5f, 100), 0.5f, 7000));
  for (std::size_t b = 0; b < layout.blocks.size(); ++b) {
    const Block& block = layout.blocks[b];
    Eigen::MatrixXd whitening = Eigen::MatrixXd::Identity(block.size, block.size);
    for (int i = 0; i < block.size; ++i) {
      StatVector one(layout.size, 0.f);
      one[block.offset + i] = 1;
      const Whitened column = standard.difference(one);
      if (standard.spread()[block.offset + i] == 0) continue;
      for (int k = 0; k < block.size; ++k) whitening(k, i) = column[block.offset + k];
    }
    const Eigen::MatrixXd triangles = whitening.partialPivLu().matrixLU();
    EXPECT_NEAR(standard.log_determinant(b), -2 * triangles.diagonal().array().abs().log().sum(), 1e-3 * block.size)
        << b;
    if (b == 3) {
      EXPECT_EQ(std::count_if(standard.spread().begin() + block.offset, standard.spread().end(),
                              [](float s) { return s > 0; }),
                known);
    }
  }
}

TEST(Standard, WhatIsSmoothAndWeakMakesRecordingsWithItLikelierWhereItBelongsToTheModel) {
  // Its power is a sixteenth of the noise's in an element, but sixteen times that in slow waves: whoever counts the
  // spread of single elements only, takes the model that lacks it for the better one.
  Layout layout;
  for (int c = 0; c < 20; ++c) {
    layout.blocks.push_back({c, 0, layout.size, 24 * 32, 24, 32, true});
    layout.size += 24 * 32;
    layout.train.push_back(true);
  }
  layout.captures = 20;
  const StatVector measured(layout.size, 0.f);
  const auto without = simulations(layout, 20, 0.5f, 100);
  const auto recordings = with_patches(layout, simulations(layout, 4, 0.5f, 40000), 0.125f, 9000);
  const auto score = [&](const Standard& standard) {
    double sum = 0;
    for (std::size_t b = 0; b < layout.blocks.size(); ++b) sum += standard.log_determinant(b);
    for (const auto& recording : recordings) {
      const Whitened y = standard.linear(recording);
      sum += dot(y, y) / static_cast<double>(recordings.size());
    }
    return sum / layout.size;
  };
  const double right = score(Standard(layout, measured, with_patches(layout, without, 0.125f, 50000))),
               wrong = score(Standard(layout, measured, without));
  // A sixteenth of the waves have twice the power: 1 - ln 2 each, 0.019 an element; a third of it lies elsewhere.
  EXPECT_LT(right, wrong - 0.005);
}

TEST(Standard, MapsThatMoveAsWholesSayHowStrongNoiseIsOnlyOnce) {
  // Noise maps of 12 captures that are larger or smaller as wholes, and towards one side, from recording to recording.
  Layout layout;
  const int noise = 1, rows = 24, cols = 32, captures = 12;
  ASSERT_EQ(segments()[noise].name, "noise");
  for (int c = 0; c < captures; ++c) {
    layout.blocks.push_back({c, noise, layout.size, rows * cols, rows, cols, true});
    layout.size += rows * cols;
    layout.train.push_back(true);
  }
  layout.captures = captures;
  const auto shaken = [&](int count, float strength, std::uint64_t key) {
    auto result = simulations(layout, count, 1, key);
    for (int k = 0; k < count; ++k)
      for (int c = 0; c < captures; ++c) {
        const auto dice = normals(2, key + 1000 * (k + 1) + 31 * c);
        for (int i = 0; i < rows * cols; ++i)
          result[k][layout.blocks[c].offset + i] += strength * (dice[0] + dice[1] * (i % cols) / cols);
      }
    return result;
  };
  const StatVector measured(layout.size, 0.f);
  const auto sums = [&](const Standard& standard, const std::vector<StatVector>& recordings) {
    double square = 0;
    for (const auto& recording : recordings) {
      const Whitened y = standard.linear(recording);
      for (const Block& block : layout.blocks) {
        double sum = 0;
        for (int i = 0; i < block.size; ++i) sum += y[block.offset + i];
        square += sum * sum / block.size / captures / static_cast<double>(recordings.size());
      }
    }
    return square;  // 1: elements are independent
  };
  // 480 sums: 6.5 % from chance, 20 % from the covariance of 288 coefficients and the spread of 24 simulations.
  EXPECT_NEAR(sums(Standard(layout, measured, shaken(24, 0.5f, 5000)), shaken(40, 0.5f, 70000)), 1, 0.3);
  // Given back, elements are in units of their own spread.
  const Standard shaking(layout, measured, shaken(24, 0.5f, 5000));
  const StatVector recording = shaken(1, 0.5f, 90000)[0];
  const Whitened back = shaking.with_modes(shaking.linear(recording));
  for (int i = 0; i < layout.size; i += 97)
    EXPECT_NEAR(back[i], (recording[i] - shaking.mean()[i]) / shaking.spread()[i], 1e-3) << i;
  // What does not move together stays as it was: each element by its own spread alone.
  const auto calm = shaken(24, 0.f, 5000);
  const Standard standard(layout, measured, calm);
  StatVector one(layout.size, 0.f);
  one[5] = 1;
  const Whitened y = standard.difference(one);
  EXPECT_NEAR(y[5], 1 / standard.spread()[5], 1e-6);
  EXPECT_EQ(std::count(y.begin(), y.end(), 0.f), layout.size - 1);
}

TEST(LeftByMostCaptures, IsWhatTheOneInTheMiddleLeavesBesideItsBias) {
  Layout layout;
  int bias = 0;
  while (segments()[bias].name != "bias") ++bias;
  const int other = bias == 0 ? 1 : 0;
  for (int c = 0; c < 4; ++c) {
    layout.blocks.push_back({c, bias, layout.size, 10, 1, 10, true});
    layout.blocks.push_back({c, other, layout.size + 10, 4, 1, 4, true});
    layout.size += 14;
  }
  layout.captures = 4;
  Whitened rest(layout.size, 0.f);
  EXPECT_EQ(left_by_most_captures(layout, rest), 0);
  for (int c = 0; c < 3; ++c)  // nothing is known of the fourth
    for (int i = 0; i < 14; ++i) rest[14 * c + i] = i < 10 ? 50.f : static_cast<float>(c == 1 ? 9 : c + 1);
  EXPECT_NEAR(left_by_most_captures(layout, rest), 9, 1e-6);  // 1, 81 and 9
}

TEST(MisfitByBlocks, LinesOfAFewElementsWeighMoreThanAHairOnALargeMap) {
  const Layout layout = small_layout();
  // Train: the map at a mean square of 9, the five lines at 100. Nothing is known of the capture held out.
  Whitened off(layout.size, 0.f);
  for (int i = 0; i < 192; ++i) off[i] = i % 2 ? 3.f : -3.f;
  for (int i = 192; i < 197; ++i) off[i] = 10.f;
  EXPECT_NEAR(misfit_by_blocks(layout, off), 197 / 2. * (std::log(9.) + std::log(100.)), 1e-3);

  Whitened nearer = off, lines = off;
  for (int i = 0; i < 192; ++i) nearer[i] *= 0.96f;   // chi falls by 135
  for (int i = 192; i < 197; ++i) lines[i] *= 0.75f;  // and by 219 here:
  for (int i = 0; i < 192; ++i) lines[i] *= 1.07f;    // but it grows by 250 there
  EXPECT_LT(dot(nearer, nearer), dot(off, off));
  EXPECT_GT(dot(lines, lines), dot(off, off));
  EXPECT_LT(misfit_by_blocks(layout, nearer), misfit_by_blocks(layout, off));
  EXPECT_LT(misfit_by_blocks(layout, lines), misfit_by_blocks(layout, nearer));
}

TEST(MisfitByBlocks, WhatIsNearerThanTheModelsOwnRandomnessIsNotNearerStill) {
  const Layout layout = small_layout();
  EXPECT_EQ(misfit_by_blocks(layout, Whitened(layout.size, 0.f)), 0);
  EXPECT_EQ(misfit_by_blocks(layout, Whitened(layout.size, 0.5f)), 0);
  EXPECT_EQ(misfit_by_blocks(layout, Whitened(layout.size, 0.9f)), 0);
}

/// `captures` segments of 40 elements, each the mean of what it and its neighbours were.
struct Correlated {
  Layout layout;
  explicit Correlated(int captures) {
    for (int c = 0; c < captures; ++c) {
      layout.blocks.push_back({c, 5, layout.size, 40, 1, 40, true});
      layout.size += 40;
      layout.train.push_back(true);
    }
    layout.captures = captures;
  }
  std::vector<StatVector> simulations(int count, std::uint64_t key) const {
    std::vector<StatVector> result;
    for (int k = 0; k < count; ++k) {
      const auto raw = normals(layout.size + 2, key + k);
      result.emplace_back(layout.size);
      for (int i = 0; i < layout.size; ++i) result.back()[i] = 2 * (raw[i] + raw[i + 1] + raw[i + 2]);
    }
    return result;
  }
  /// Mean square of the simulations that taught the standard over that of others.
  double optimism() const {
    const auto taught = simulations(48, 100);
    const Standard standard(layout, StatVector(layout.size, 0.f), taught);
    const auto square = [&](const std::vector<StatVector>& of) {
      double sum = 0;
      for (const auto& one : of) sum += dot(standard.linear(one), standard.linear(one)) / of.size();
      return sum;
    };
    return square(taught) / square(simulations(48, 900));
  }
};

TEST(Standard, SegmentsOfManyCapturesLearnTheirCorrelationTogether) {
  // The mean of 48 takes 1 / 48 of their square away and adds as much to others': 0.96 if the correlation were known.
  const double alone = Correlated(1).optimism(), together = Correlated(8).optimism(), known = 47.0 / 49;
  EXPECT_LT(alone, 0.75);
  EXPECT_GT(together, 0.5 * (alone + known)) << "most of what one segment alone flatters itself with, " << alone;
}

TEST(Standard, UnknownElementsSayNothing) {
  const Layout layout = small_layout();
  auto sims = simulations(layout, 12, 1, 5);
  const Standard standard(layout, StatVector(layout.size, 0.f), sims);
  StatVector all_unknown(layout.size, std::numeric_limits<float>::quiet_NaN());
  for (float v : standard.standardise(all_unknown)) EXPECT_EQ(v, 0);
}

TEST(Standard, WhatWasNotMeasuredDoesNotCount) {
  const Layout layout = small_layout();
  StatVector measured(layout.size, 0.f);
  measured[5] = measured[layout.size - 1] = std::numeric_limits<float>::quiet_NaN();
  const Standard standard(layout, measured, simulations(layout, 12, 1, 5));
  const Whitened y = standard.linear(simulations(layout, 1, 1, 77)[0]);
  for (int i : {5, layout.size - 1}) {
    EXPECT_EQ(standard.spread()[i], 0);
    EXPECT_EQ(y[i], 0);
  }
  EXPECT_GT(standard.spread()[6], 0);
}

TEST(Standard, CompressionKeepsSmallAndBoundsLarge) {
  Whitened y{0.1f, -2, 80};
  compress(y);
  EXPECT_FLOAT_EQ(y[0], 0.1f);
  EXPECT_NEAR(y[1], -2, 0.03);
  EXPECT_LT(y[2], 30);
  EXPECT_NEAR(compression_slope(y[2]), 1 / std::sqrt(1 + 100.0), 1e-4);  // d/dr 8 asinh(r/8) at r = 80
}

class MetricTest : public ::testing::Test {
 protected:
  Layout layout = small_layout();
  NuisanceRow pose{normals(layout.size, 7), 0}, global{normals(layout.size, 8), -1};

  void SetUp() override {
    for (int i = layout.size / 2; i < layout.size; ++i) pose.change[i] = 0;
    for (float& v : pose.change) v *= 30;  // moves y by far more than its noise: nearly free
    for (float& v : global.change) v *= 30;
  }
};

TEST_F(MetricTest, NuisancesDoNotCount) {
  const Metric metric(layout, Part::train, {pose, global});
  Whitened moved = pose.change;
  for (int i = 0; i < layout.size; ++i) moved[i] = 0.5f * moved[i] + 0.3f * global.change[i];
  const double before = dot(moved, moved), after = dot(moved, metric.apply(moved));
  EXPECT_LT(after, 1) << "what is left of it costs no more than the priors: 0.5^2 + 0.3^2";
  EXPECT_GT(before, 1e4);
  // And anything else still does: two of 197 directions are gone.
  const Whitened other = normals(layout.size, 99);
  EXPECT_GT(dot(other, metric.apply(other)), 0.85 * layout.size / 2);
}

TEST_F(MetricTest, IsSymmetricAndBlindToTheOtherSide) {
  const Metric metric(layout, Part::train, {pose, global});
  const Whitened a = normals(layout.size, 1), b = normals(layout.size, 2);
  EXPECT_NEAR(dot(a, metric.apply(b)), dot(b, metric.apply(a)), 1e-3 * layout.size);
  const Whitened q = metric.apply(a);
  for (int i = layout.size / 2; i < layout.size; ++i) EXPECT_EQ(q[i], 0);
}

TEST_F(MetricTest, EstimatesWhatMoved) {
  const Metric metric(layout, Part::train, {pose, global});
  Whitened y(layout.size);
  for (int i = 0; i < layout.size; ++i) y[i] = 0.7f * pose.change[i] - 0.4f * global.change[i];
  const auto values = metric.estimate(y);
  EXPECT_NEAR(values[0], 0.7, 0.01);
  EXPECT_NEAR(values[1], -0.4, 0.01);
}

TEST_F(MetricTest, FarFromWhatWasStatedCountsAndFarFromAWideGuessDoesNot) {
  pose.stated = global.stated = true;
  NuisanceRow guess{normals(layout.size, 9), -1};
  for (float& v : guess.change) v *= 30;
  const Metric metric(layout, Part::train, {pose, global, guess});
  Whitened y(layout.size);
  for (int i = 0; i < layout.size; ++i) y[i] = 0.5f * pose.change[i] - global.change[i] + 0.5f * guess.change[i];
  const Explained found = metric.explain(y);
  EXPECT_NEAR(found.stated.poses, 0.25, 0.02);
  EXPECT_NEAR(found.stated.intrinsics, 1, 0.04) << "of one row: the guess is none";
  EXPECT_NEAR(found.shared_prior, 1, 0.04);
  // Held out, around what train found: the distance is still that from what was stated.
  const Metric test(layout, Part::test, {pose, global, guess}, metric.global_posterior());
  EXPECT_NEAR(test.explain(y, {}, found.global).stated.intrinsics, 1, 0.04);
}

TEST(PValue, FallsWithTheGainAndSaysWhereItIsExtrapolated) {
  std::vector<double> nulls;
  for (int k = 0; k < 50; ++k) nulls.push_back(std::pow(RandomStream(4).normal(k), 2));
  const PValue small = gain_p_value(0.5, nulls), large = gain_p_value(40, nulls);
  EXPECT_GT(small.p, 0.2);
  EXPECT_FALSE(small.extrapolated);
  EXPECT_LT(large.p, 1 / 51.0);
  EXPECT_TRUE(large.extrapolated);
  EXPECT_LT(gain_p_value(60, nulls).p, large.p);
}

// Holding a nuisance where it is, is never to have heard of it; on the captures held out, too, whose prior is what
// train says.
TEST(Metric, OneThatIsHeldIsNoNuisance) {
  const Layout layout = small_layout();
  std::vector<NuisanceRow> rows{{normals(layout.size, 1), 0}, {normals(layout.size, 2), 1}};
  for (std::uint64_t key = 3; key < 7; ++key) rows.push_back({normals(layout.size, key), -1});
  auto fewer = rows;
  fewer.erase(fewer.begin() + 5), fewer.erase(fewer.begin() + 3);
  Whitened y = normals(layout.size, 20);
  for (int i = 0; i < layout.size; ++i) y[i] += 0.7f * rows[3].change[i] - 0.4f * rows[4].change[i];
  const Metric train(layout, Part::train, rows), without(layout, Part::train, fewer);
  const Metric test(layout, Part::test, rows, train.global_posterior()),
      test_without(layout, Part::test, fewer, without.global_posterior());
  const Explained held = train.with_held({3, 5}).explain(y), expected = without.explain(y);
  ASSERT_GT(expected.chi, 1.2 * train.explain(y).chi);  // it was some of what made up for y
  EXPECT_NEAR(held.chi, expected.chi, 1e-4 * expected.chi);
  EXPECT_EQ(held.values[3], 0);
  EXPECT_NEAR(held.values[4], expected.values[3], 1e-5);
  const Explained test_held = test.with_held({3, 5}).explain(y, {}, held.global);
  EXPECT_NEAR(test_held.chi, test_without.explain(y, {}, expected.global).chi, 1e-3);
  for (int i = 0; i < layout.size; ++i) ASSERT_NEAR(held.rest[i], expected.rest[i], 1e-4);
  EXPECT_EQ(train.with_held({}).explain(y).chi, train.explain(y).chi);
}

TEST(Metric, OnAnotherScaleItIsThatOfTheRowsOnThatScale) {
  const Layout layout = small_layout();
  std::vector<NuisanceRow> rows{
      {normals(layout.size, 1), 0}, {normals(layout.size, 2), 1}, {normals(layout.size, 3), -1}};
  const auto changed = [&](const Whitened& y) {  // every block by the sum of its elements
    Whitened result = y;
    for (const Block& block : layout.blocks) {
      float sum = 0;
      for (int i = 0; i < block.size; ++i) sum += y[block.offset + i];
      for (int i = 0; i < block.size; ++i) result[block.offset + i] += 0.3f * sum;
    }
    return result;
  };
  auto rows_changed = rows;
  for (NuisanceRow& row : rows_changed) row.change = changed(row.change);
  const Metric train(layout, Part::train, rows), expected(layout, Part::train, rows_changed);
  const Metric test(layout, Part::test, rows, train.global_posterior()),
      test_expected(layout, Part::test, rows_changed, expected.global_posterior());
  const Metric train_changed = train.on_scale(changed),
               test_changed = test.on_scale(changed, expected.global_posterior());
  const Whitened y = normals(layout.size, 20);
  ASSERT_GT(std::abs(train.explain(y).chi - expected.explain(y).chi), 1);
  EXPECT_NEAR(train_changed.explain(y).chi, expected.explain(y).chi, 1e-4);
  EXPECT_NEAR(test_changed.explain(y).chi, test_expected.explain(y).chi, 1e-4);
  EXPECT_TRUE(train_changed.global_posterior().isApprox(expected.global_posterior(), 1e-6));
}

}  // namespace
}  // namespace binrig
