#include "diagnose/slopes.h"

#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

#include "core/random.h"
#include "diagnose/experiment.h"
#include "diagnose/hypotheses.h"
#include "sim/effect.h"

namespace binrig {
namespace {

constexpr float unknown = std::numeric_limits<float>::quiet_NaN();

Layout one_map() {
  Layout layout;
  layout.blocks.push_back({0, 0, 0, 20 * 30, 20, 30, true});
  layout.size = 20 * 30;
  layout.train = {true};
  layout.captures = 1;
  return layout;
}

Whitened normals(int size, std::uint64_t key, float scale) {
  Whitened v(size);
  const RandomStream stream(key);
  for (int i = 0; i < size; ++i) v[i] = scale * static_cast<float>(stream.normal(i));
  return v;
}

/// A shift of the whole map, which a parameter can hardly be told from, and a residual with far outliers.
struct Scene {
  Layout layout = one_map();
  Metric metric{layout, Part::train, {{Whitened(layout.size, 3.f), 0}}};
  Whitened slope = normals(layout.size, 1, 0.2f), residual = normals(layout.size, 2, 2.f);
  Scene() {
    for (float& v : slope) v += 5;
    for (float& v : residual) v += 4;
    residual[7] = 90, residual[100] = -60;
  }
  double chi(double at) const {
    Whitened left = residual;
    for (std::size_t i = 0; i < left.size(); ++i) left[i] -= static_cast<float>(at) * slope[i];
    return metric.explain(left).chi;
  }
};

TEST(Pull, IsTheGradientOfChiWithItsPriorAndItsCompression) {
  const Scene scene;
  const Pull pull(scene.metric.explain(scene.residual).rest);
  const Whitened freed = scene.metric.apply(scene.slope);
  const double analytic = -2 * pull.along(pull.direct(), scene.slope, freed);
  // Central differences of a smooth function: their error is of second order, 1e-4 of it; single precision of chi
  // (some 5000 of it) adds 5e-4 / 0.1.
  const double step = 0.05, numeric = (scene.chi(step) - scene.chi(-step)) / (2 * step);
  EXPECT_NEAR(analytic, numeric, 0.01 * std::abs(numeric) + 0.05);
}

TEST(Pull, CurvatureIsThatOfASmallResidual) {
  Scene scene;
  for (float& v : scene.residual) v *= 0.01f;
  const Pull pull(scene.metric.explain(scene.residual).rest);
  const Whitened freed = scene.metric.apply(scene.slope);
  const double analytic = 2 * dot(pull.curved(scene.slope, freed), freed);
  const double step = 0.2;
  const double numeric = (scene.chi(step) - 2 * scene.chi(0) + scene.chi(-step)) / (step * step);
  EXPECT_NEAR(analytic, numeric, 0.02 * numeric);
}

TEST(Products, NoiseOfDerivativesIsNoInformation) {
  // True derivatives are 0.1 everywhere; each seed's noise is ten times that.
  const int size = 4000, seeds = 4;
  SeedSlopes slopes(1);
  for (int k = 0; k < seeds; ++k) {
    slopes[0].push_back(normals(size, 50 + k, 1.f));
    for (float& v : slopes[0].back()) v += 0.1f;
  }
  const double truth = 0.01 * size;
  // Mean of 12 products of independent noise over 4000 elements, and of noise with the truth.
  const double spread = std::sqrt(size / 6.0 + size * 0.01);
  EXPECT_NEAR(unbiased_products(slopes, slopes)(0, 0), truth, 4 * spread);
  EXPECT_GT(products_of_means(slopes, slopes)(0, 0), truth + 0.8 * size / seeds);
}

TEST(Products, StayPositiveAndKeepSilentParametersSilent) {
  Eigen::MatrixXd together(3, 3), unbiased(3, 3);
  together << 4, 3, 0, 3, 4, 0, 0, 0, 0;
  unbiased << 1, 2, 0, 2, 1, 0, 0, 0, 0;  // indefinite: noise was taken off
  const Eigen::MatrixXd positive = positive_products(unbiased, together, Eigen::Vector3d(1, 1, 1));
  const Eigen::VectorXd values =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(positive.topLeftCorner(2, 2)).eigenvalues();
  EXPECT_NEAR(values[0], 0.1, 1e-9) << "a twentieth of the 2 taken off along (1, -1)";
  EXPECT_NEAR(values[1], 3, 1e-9);
  EXPECT_EQ(positive.row(2).norm(), 0);
}

TEST(Products, WhereTwoMakeUpForEachOtherNoiseOfOneIsNoInformation) {
  // The second derivative is 30 times the first but for a small part of its own, which is all that the data know of the
  // two apart; the first has noise.
  const int size = 4000, seeds = 4;
  const Whitened common = normals(size, 1, 1.f), rest = normals(size, 2, 0.3f);
  SeedSlopes slopes(2);
  for (int k = 0; k < seeds; ++k) {
    const Whitened noise = normals(size, 10 + k, 0.5f);
    for (auto& of : slopes) of.emplace_back(size);
    for (int i = 0; i < size; ++i) {
      slopes[0][k][i] = common[i] + noise[i];
      slopes[1][k][i] = 30 * common[i] + rest[i];
    }
  }
  const Eigen::MatrixXd found =
      positive_products(unbiased_products(slopes, slopes), products_of_means(slopes, slopes), Eigen::Vector2d(1, 1));
  // Variance of the first with the second free: size * (1 - its share along the second) is 0.3^2 / 30^2 of size. Noise
  // of the unbiased products (1 sigma: 0.25 / sqrt(6) sqrt(size) = 6.5, with common 0.5 sqrt(size) = 32) is far above
  // that, so that only the floor is left: a twentieth of the noise, 0.05 * 0.25 / 4 * size.
  const double known = found.determinant() / found(1, 1), noise = 0.25 / seeds * size;
  EXPECT_GT(known, 0);
  EXPECT_LT(known, 0.4 * noise) << "not the noise itself, " << noise;
}

TEST(Pooling, WhatPixelsTossForIsSaidByTheMeanOfAMap) {
  const Layout layout = one_map();
  std::vector<float> spread(layout.size, 1.f);
  for (int i = 0; i < 100; ++i) spread[i] = 0;  // unknown
  const int seeds = 2;
  std::vector<Whitened> tossed(seeds, Whitened(layout.size, 0.f)), clear = tossed, nothing = tossed;
  for (int k = 0; k < seeds; ++k) {
    const RandomStream stream(70 + k);
    for (int i = 100; i < layout.size; ++i) {
      tossed[k][i] = stream.uniform(i) < 0.1 ? 10.f : 0.f;
      clear[k][i] = i % 30 < 15 ? 1.f : -1.f;
    }
    nothing[k] = normals(layout.size, 80 + k, 1.f);
    for (int i = 0; i < 100; ++i) nothing[k][i] = 0;
  }
  // Element by element 0.1 of each seed's mean square of 10 is signal; of the maps' means, chance takes 3 / sqrt(500).
  EXPECT_LT(mean_over_seeds(layout, tossed).signal[0], 0.5);
  EXPECT_TRUE(pool_noisy(layout, spread, 0.5, tossed)[0]);
  EXPECT_FALSE(pool_noisy(layout, spread, 0.5, clear)[0]) << "a pattern stays one";
  for (int i = 100; i < layout.size; ++i) nothing[1][i] -= 2;  // their means contradict each other
  for (int i = 100; i < layout.size; ++i) nothing[0][i] += 2;
  EXPECT_FALSE(pool_noisy(layout, spread, 0.5, nothing)[0]);
  EXPECT_EQ(tossed[0][99], 0) << "unknown";
  EXPECT_EQ(tossed[0][100], tossed[0][599]);
  EXPECT_NEAR(tossed[0][100], 1, 4 * 3 / std::sqrt(500.0));
}

TEST(FillUnknown, OthersFirstThenTheBlock) {
  const Layout layout = one_map();
  std::vector<StatVector> two(2, StatVector(layout.size, 2.f));
  two[0][3] = unknown;
  two[1][3] = 7;
  two[0][9] = two[1][9] = unknown;
  auto kept = two;
  fill_unknown(layout, kept);
  EXPECT_EQ(kept[0][3], 7);
  EXPECT_TRUE(std::isnan(kept[0][9]));
  fill_unknown(layout, two, true);
  EXPECT_NEAR(two[1][9], 2 + 10.0 / (2 * layout.size), 0.01);
}

TEST(ByPeriod, NeighboursDifferByOnePeriodAcrossTheImage) {
  const int width = 128;
  int with_period = 0;
  for (const EffectDeclaration* effect : effect_catalogue().all()) {
    Hypothesis hypothesis{effect->name, effect, {}};
    std::map<std::string, double> values;
    const ParameterSpec *phase = nullptr, *period = nullptr;
    for (const auto& spec : effect->parameters) {
      values[spec.name] = spec.initial;
      if (spec.kind == ParameterKind::phase) phase = &spec;
      if (!spec.interpolate && spec.log_scaled && spec.name != effect->amplitude) period = &spec;
    }
    const std::vector<Hypothesis> close = by_period(hypothesis, values, width);
    if (!phase || !period) {
      EXPECT_TRUE(close.empty()) << effect->name;
      continue;
    }
    ++with_period;
    ASSERT_EQ(close.size(), 1u + width / 4) << effect->name;
    EXPECT_EQ(close[0].paths.at(0).atoms.at(0).values.at(period->name), values.at(period->name)) << "the one to beat";
    double before = 0;
    for (std::size_t k = 0; k < close.size(); ++k) {
      ASSERT_EQ(close[k].paths.size(), 2u);
      const auto& atom = close[k].paths[0].atoms.at(0).values;
      EXPECT_EQ(close[k].paths[1].quadrature_of, 0);
      EXPECT_NEAR(close[k].paths[1].atoms.at(0).values.at(phase->name) - atom.at(phase->name), std::numbers::pi / 2,
                  1e-12);
      const double inverse = 1 / atom.at(period->name);
      if (k > 1 && period->typical_low >= 4 && period->unit == "px") {
        EXPECT_LE(width * (inverse - before), 1.05);
      }
      before = inverse;
    }
    EXPECT_NEAR(before, 1 / period->typical_low, 1e-9);
  }
  EXPECT_GE(with_period, 3) << "two bandings and the wiggling";
}

}  // namespace
}  // namespace binrig
