#include "diagnose/unit_map.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "core/random.h"
#include "tests/diagnose/simulated_case.h"

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

/// Noise through a Gaussian of `sigma_cells`, of unit variance.
std::vector<float> smooth_map(std::uint64_t key, double sigma_cells) {
  constexpr int margin = 8;
  auto noise = normals((rows + 2 * margin) * (cols + 2 * margin), key);
  cv::Mat field(rows + 2 * margin, cols + 2 * margin, CV_32F, noise.data());
  cv::GaussianBlur(field, field, {}, sigma_cells);
  const cv::Mat kernel = cv::getGaussianKernel(4 * margin + 1, sigma_cells);
  const cv::Mat map = field(cv::Rect(margin, margin, cols, rows)) / kernel.dot(kernel);  // of the variance
  std::vector<float> result;
  for (int i = 0; i < cells; ++i) result.push_back(map.at<float>(i / cols, i % cols));
  return result;
}

TEST(UnitMap, BandsAreNoRandomMapHoweverWeak) {
  const Stand stand;
  const UnitMap map = stand.learned();
  // Mean square 0.06 under noise of 1 / 8 in a map of eight captures: too little for its rings to be judged. In the
  // cosines constant along columns, 192 * 0.06 stand against a dozen times 1 / 8: some 19 standard deviations.
  constexpr float amplitude = 0.35f;
  std::vector<float> columns(cells), lines(cells);
  for (int i = 0; i < cells; ++i) {
    columns[i] = std::sin(1.5f * static_cast<float>(i % cols));
    lines[i] = std::sin(1.5f * static_cast<float>(i / cols));
  }
  for (const auto& bands : {columns, lines}) {
    EXPECT_FALSE(map.looks_random(stand.rest(recording(bands, amplitude, 8000))));
    EXPECT_TRUE(map.has_bands(stand.rest(recording(bands, 2 * amplitude, 8000))));
  }
  for (std::uint64_t k = 0; k < 20; ++k) {
    EXPECT_TRUE(map.looks_random(stand.rest(recording(normals(cells, 7000 + k), 0.7f * amplitude, 8100 + k)))) << k;
    // Of another texture than the units it was learned from, and far stronger than any noise.
    EXPECT_FALSE(map.has_bands(stand.rest(recording(smooth_map(7100 + k, 1.5), 4, 8200 + k)))) << k;
  }
}

TEST(UnitMap, ASmoothMapThatIsSteepAtTheBorderHasNoBands) {
  // Whitening leaves more of what is smooth at the border than within, and a coarse map does not close: both put power
  // into cosines that are constant along rows or columns, under which hardly any is when the map is coarse.
  const Stand stand;
  const UnitMap map = stand.learned();
  for (std::uint64_t k = 0; k < 20; ++k) {
    auto coarse = smooth_map(7300 + k, 3);
    for (int i = 0; i < cells; ++i)
      if (i % cols == 0 || i % cols == cols - 1 || i / cols == 0 || i / cols == rows - 1) coarse[i] *= 2.5f;
    EXPECT_FALSE(map.has_bands(stand.rest(recording(coarse, 4, 8400 + k)))) << k;
  }
}

TEST(UnitMap, RingsAreNoSmoothRandomMap) {
  // As strong and as coarse, in the same captures: what tells them apart is that rings have one scale.
  const Stand stand;
  std::vector<StatVector> without, with;
  for (std::uint64_t k = 0; k < 4; ++k) {
    without.push_back(StatVector(stand.layout.size, 0.f));
    with.push_back(recording(smooth_map(500 + k, 1.2), 1, 0));
  }
  const UnitMap map(stand.layout, stand.rung, without, with);
  for (const float strength : {0.7f, 1.5f})
    EXPECT_TRUE(map.looks_random(stand.rest(recording(smooth_map(600, 1.2), strength, 9000)))) << strength;
  std::vector<float> rings(cells);
  for (int i = 0; i < cells; ++i)
    rings[i] =
        1.4f * std::cos(1.5f * std::hypot(static_cast<float>(i % cols) - 7.5f, static_cast<float>(i / cols) - 5.5f));
  const Whitened rest = stand.rest(recording(rings, 1, 9000));
  EXPECT_GT(map.gain(rest, rest).test, 100);  // it is fixed in the image
  EXPECT_FALSE(map.looks_random(rest));
}

TEST(UnitMap, ManyUnitsTellASpiralFromASmoothMap) {
  const Stand stand;
  std::vector<StatVector> without, with;
  for (std::uint64_t k = 0; k < 16; ++k) {
    without.push_back(StatVector(stand.layout.size, 0.f));
    with.push_back(recording(smooth_map(500 + k, 0.9), 1, 0));
  }
  const UnitMap map(stand.layout, stand.rung, without, with);
  int refused = 0, taken = 0;
  for (std::uint64_t k = 0; k < 200; ++k)
    refused += !map.looks_random(stand.rest(recording(smooth_map(2000 + k, 0.9), 1, 9000 + k)));
  for (int k = 0; k < 20; ++k) {
    std::vector<float> spiral(cells);
    for (int i = 0; i < cells; ++i) {
      const float x = static_cast<float>(i % cols) - 7.5f, y = static_cast<float>(i / cols) - 5.5f;
      spiral[i] = 1.4f * std::cos(3 * std::atan2(y, x) + 1.2f * std::hypot(x, y) + 0.31f * static_cast<float>(k));
    }
    taken += map.looks_random(stand.rest(recording(spiral, 1, 9500 + static_cast<std::uint64_t>(k))));
  }
  EXPECT_LE(refused, 1);
  // By the rings' misfit alone thirteen are: so small an image has few rings, which few spirals miss.
  EXPECT_LE(taken, 4);
}

TEST(UnitMap, AMatchTellsHowStrongAMapIs) {
  const Stand stand;
  std::vector<StatVector> without, with;
  for (std::uint64_t k = 0; k < 4; ++k) {
    without.push_back(StatVector(stand.layout.size, 0.f));
    with.push_back(recording(normals(cells, 700 + k), 0.5f, 0));
  }
  const UnitMap map(stand.layout, stand.rung, without, with);
  const Whitened strong = stand.rest(recording(normals(cells, 800), 1, 9000));
  const auto segment = map.strongest(strong);
  ASSERT_TRUE(segment.has_value());
  std::vector<Whitened> units;
  for (const StatVector& one : with) units.push_back(stand.rung.standard.difference(one));
  const UnitMap::Match match = map.match(*segment, strong, map.spectrum_of_units(*segment, units));
  // Twice as strong, so four times the power. 192 cells know their mean square to sqrt(2/192) = 0.10, four units
  // theirs to 0.05, compression takes some hundredths: three standard deviations.
  EXPECT_NEAR(match.log_scale, std::log(4), 0.35);
}

TEST(UnitMap, NoiseThatIsNewInEveryCaptureIsNoPartOfWhatUnitsShow) {
  // As where a map moves values across steps of quantisation: what units change is noise, too, as strong as any.
  const Stand stand;
  std::vector<StatVector> without, with;
  for (std::uint64_t k = 0; k < 4; ++k) {
    without.push_back(StatVector(stand.layout.size, 0.f));
    with.push_back(recording(smooth_map(700 + k, 1.2), 1, 750 + k));
  }
  const UnitMap map(stand.layout, stand.rung, without, with);
  const auto segment = map.strongest(stand.rest(recording(smooth_map(800, 1.2), 1, 850)));
  ASSERT_TRUE(segment.has_value());
  std::vector<Whitened> units;
  for (const StatVector& one : with) units.push_back(stand.rung.standard.difference(one));
  // Of a map as smooth as that, the finest cosines hold next to nothing; of noise in eight captures, 1/8. What halves
  // of them have in common by chance, in four units and some fifty cosines: 1/4 / sqrt(200) = 0.018.
  const std::vector<double> power = map.spectrum_of_units(*segment, units).power;
  EXPECT_LT(power.back(), 0.054);
  EXPECT_GT(power.front(), 1);
}

TEST(UnitMap, AMapInOneCornerIsNoRandomMapWhereCellsAreKnownUnequallyWell) {
  // A quarter of the cells, strewn, knows a map three and a half times as well as the others: values of kurtosis 8.
  const Stand stand;
  const auto unequal = [](std::uint64_t unit) {
    auto map = normals(cells, unit);
    const RandomStream stream(3);
    for (int i = 0; i < cells; ++i) map[i] *= stream.uniform(i) < 0.25 ? 2.5f : 0.7f;
    return map;
  };
  std::vector<StatVector> without, with;
  for (std::uint64_t k = 0; k < 4; ++k) {
    without.push_back(StatVector(stand.layout.size, 0.f));
    with.push_back(recording(unequal(900 + k), 1, 0));
  }
  const UnitMap map(stand.layout, stand.rung, without, with);
  for (std::uint64_t k = 0; k < 10; ++k) {
    EXPECT_TRUE(map.looks_random(stand.rest(recording(unequal(920 + k), 1, 9100 + k)))) << k;
    auto corner = normals(cells, 940 + k);
    for (int i = 0; i < cells; ++i) corner[i] *= i % cols < 4 && i / cols < 4 ? 4.f : 0.f;
    EXPECT_FALSE(map.looks_random(stand.rest(recording(corner, 1, 9200 + k)))) << k;
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

TEST(FitUnitMap, FindsTheSameRateWhereverItBegins) {
  // How the map's power grows with the rate is learned on the way, from however short a step.
  constexpr int frames = 4;
  bench::Campaign planes(7);
  for (const double distance : {700.0, 800.0}) planes.plane("train", "plane", frames, distance);
  planes.plane("test", "plane_2", frames, 750);
  const bench::SmallCampaign large(planes, 320);
  constexpr double truth = 0.002;
  constexpr std::uint64_t seed = 80;
  SensorModel instrument = model_with("random_dropout", {{"rate", 0.01}});
  add_effect(instrument, effect_catalogue(), "dead_pixels", {{"rate", truth}});
  const Case c(instrument, without_effect(instrument, "dead_pixels"), large);
  const Rung rung = c.fitted({.simulations = 24});
  const Hypotheses all = make_hypotheses(large.forward(), c.start);
  const Hypothesis& dead = *std::ranges::find(all.tested, "dead_pixels", &Hypothesis::effect);
  const auto without = c.experiment.simulate(UnitMap::trials_of(rung, rung.model, seed));
  std::vector<double> found, deviations;
  const auto begin_at = [&](double rate) {
    const SensorModel model = with_effect(rung.model, effect_catalogue(), "dead_pixels", {{"rate", rate}});
    UnitMap start(c.experiment.layout(), rung, without, c.experiment.simulate(UnitMap::trials_of(rung, model, seed)));
    const UnitMapFit fit = fit_unit_map(c.experiment, rung, dead, {{"rate", rate}}, std::move(start), without, seed);
    found.push_back(std::log(fit.values.at("rate") / truth));
    deviations.push_back(unit_map_deviations(c.experiment, rung, dead, fit, seed).at("rate"));
    EXPECT_LT(std::abs(found.back()), 3 * deviations.back()) << rate;
    return fit.values.at("rate");
  };
  begin_at(0.75 * truth);
  begin_at(2 * truth);
  begin_at(begin_at(1.2 * truth));  // nowhere to go from there
  const auto [least, most] = std::ranges::minmax(found);
  EXPECT_LT(most - least, 0.1);  // twice what the power's logarithm is solved to
  // How many pixels are dead is drawn: N of them tell a rate to 1/sqrt(N). How power grows with the rate is read off
  // four units, to a third or so, whether there was a way to go or none.
  const auto [surest, least_sure] = std::ranges::minmax(deviations);
  EXPECT_GT(surest, 1 / std::sqrt(truth * 320 * 240));
  EXPECT_LT(least_sure, 1.5 * surest);
}

}  // namespace
}  // namespace binrig
