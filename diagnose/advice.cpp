#include "diagnose/advice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "diagnose/slopes.h"

namespace binrig {
namespace {

constexpr int seeds = 2, frames = 3;
constexpr double least_signal = 0.5;  // of a segment of a difference
/// A distance D is won by D +- 2 sqrt(D); it has to stay above 9, three standard deviations, in two cases of that.
constexpr double far_enough = 36;

struct Place {
  Offset where;
  std::string words;
};

std::vector<Place> places_of(double distance_mm, const std::optional<std::array<double, 2>>& range_mm) {
  constexpr double degree = std::numbers::pi / 180;
  std::vector<Place> places;
  for (const double factor : {0.85, 1.18}) {
    const double moved = factor * distance_mm;
    if (range_mm && (moved < (*range_mm)[0] || moved > (*range_mm)[1])) continue;
    Place place;
    place.where.pose[5] = moved - distance_mm;
    place.words = fmt::format("{:.0f} mm {}", std::abs(place.where.pose[5]), factor < 1 ? "nearer" : "further away");
    places.push_back(place);
  }
  for (const int axis : {0, 1}) {
    Place place;
    place.where.pose[axis] = 25 * degree;
    place.words = fmt::format("tilted by 25 deg about {}", axis == 0 ? "x" : "y");
    places.push_back(place);
  }
  return places;
}

}  // namespace

std::vector<AdvisedCapture> captures_that_separate(const Experiment& experiment,
                                                   const std::vector<SceneMotion>& motions, const Rung& rung,
                                                   const SensorModel& one, const std::vector<SensorModel>& others,
                                                   std::uint64_t seed) {
  const Layout& layout = experiment.layout();
  std::vector<AdvisedCapture> asked;
  for (int c = 0; c < layout.captures; ++c) {
    if (!layout.train[c] || experiment.captures()[c].power_on || experiment.context(c).motion) continue;
    const cv::Mat& depth = experiment.nominal(c).depth_mm;
    const double distance = cv::sum(depth)[0] / std::max(1, cv::countNonZero(depth));
    const CaptureInfo& capture = experiment.captures()[c];
    for (const Place& place : places_of(distance, experiment.forward().set().sensor.range_mm))
      asked.push_back({c, place.where, fmt::format("{} {} {}", capture.key(), capture.name, place.words)});
  }
  const std::vector<NuisanceRow> rows = motion_rows(layout, rung.standard, motions);
  parallel_for(static_cast<int>(asked.size()), [&](int i) {
    AdvisedCapture& advised = asked[i];
    // What a pose does to a target's depth is nearly the same wherever it stands.
    std::vector<NuisanceRow> its_poses;
    for (const NuisanceRow& row : rows)
      if (row.capture == advised.capture) its_poses.push_back(row);
    const Metric metric(layout, Part::train, its_poses);
    const auto simulate = [&](const SensorModel& model) {
      std::vector<StatVector> by_seed;
      for (std::uint64_t k = 0; k < seeds; ++k)
        by_seed.push_back(experiment.elsewhere(model, advised.capture, advised.where, seed + k, frames));
      return by_seed;
    };
    const std::vector<StatVector> with_one = simulate(one);
    advised.distance2 = std::numeric_limits<double>::infinity();
    for (const SensorModel& other : others) {
      std::vector<StatVector> changes = with_one;
      const std::vector<StatVector> with_other = simulate(other);
      for (int k = 0; k < seeds; ++k)
        for (int j = 0; j < layout.size; ++j) changes[k][j] -= with_other[k][j];
      fill_unknown(layout, changes, true);
      std::vector<Whitened> by_seed;
      for (const StatVector& change : changes) by_seed.push_back(rung.standard.difference(change));
      const Whitened mean = shrunk(layout, mean_over_seeds(layout, by_seed), least_signal);
      advised.distance2 = std::min(advised.distance2, dot(metric.apply(mean), mean));
    }
  });
  std::erase_if(asked, [](const AdvisedCapture& a) { return a.distance2 < far_enough; });
  std::stable_sort(asked.begin(), asked.end(),
                   [](const AdvisedCapture& a, const AdvisedCapture& b) { return a.distance2 > b.distance2; });
  return asked;
}

}  // namespace binrig
