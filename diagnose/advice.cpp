#include "diagnose/advice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "diagnose/slopes.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int seeds = 2, frames = 3;
constexpr double least_signal = 0.5;  // of a segment of a difference
/// A distance D is won by D +- 2 sqrt(D); it has to stay above 9, three standard deviations, in two cases of that.
constexpr double far_enough = 36;
constexpr std::size_t most_asked = 16;  // captures of which it is asked what the models' parameters may do there

struct Place {
  Offset where;
  std::string words;
};

std::vector<Place> places_of(double distance_mm, const std::optional<std::array<double, 2>>& range_mm) {
  constexpr double degree = std::numbers::pi / 180, least_move = 0.04;
  std::vector<Place> places;
  for (const double factor : {0.7, 0.85, 1.18, 1.4}) {
    double moved = factor * distance_mm;
    if (range_mm) moved = std::clamp(moved, (*range_mm)[0], (*range_mm)[1]);
    if (std::abs(moved / distance_mm - 1) < least_move || (moved < distance_mm) != (factor < 1)) continue;
    Place place;
    place.where.pose[5] = moved - distance_mm;
    if (!places.empty() && std::abs(place.where.pose[5] - places.back().where.pose[5]) < least_move * distance_mm)
      continue;
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

/// What a model may do to look like another: its parameters, and what the recording says of them and of the lens.
struct Freedom {
  std::vector<FitParameter> parameters;
  Eigen::MatrixXd precision;  // of intrinsics and parameters, in units of their priors' standard deviations
};

Freedom freedom_of(const Layout& layout, std::vector<NuisanceRow> rows, const Rung& rung, const LookAlike& model) {
  Freedom result;
  const auto add = [&](const Fit& fit, bool its_own) {
    for (std::size_t p = 0; p < std::min(fit.parameters.size(), fit.slopes.size()); ++p) {
      const FitParameter& parameter = fit.parameters[p];
      if ((parameter.id == model.id) != its_own || !model.model.find(parameter.id)) continue;
      NuisanceRow row{fit.slopes[p]};
      for (float& v : row.change) v *= static_cast<float>(parameter.prior_sigma);
      rows.push_back(std::move(row));
      result.parameters.push_back(parameter);
    }
  };
  add(rung.fit, false);
  add(model.fit, true);
  result.precision = Metric(layout, Part::train, rows).global_posterior();
  return result;
}

class Separator {
 public:
  Separator(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung, std::uint64_t seed)
      : experiment_(experiment),
        layout_(experiment.layout()),
        rung_(rung),
        seed_(seed),
        rows_(motion_rows(layout_, rung.standard, motions)) {}

  /// Square of what tells two models apart at a place, of chi, poses free.
  double distance2(const AdvisedCapture& place, const SensorModel& one, const SensorModel& other) const {
    const Metric metric(layout_, Part::train, rows_at(place, false));
    const Whitened change = difference(place, one, other);
    return dot(metric.apply(change), change);
  }

  /// What is left of it when the second model's parameters, and the lens, are fitted to the first one's capture as far
  /// as `freedom` goes, which is that of the second.
  double distance2_fitted(const AdvisedCapture& place, const SensorModel& truth, const SensorModel& model,
                          const Freedom& freedom) const {
    constexpr int steps = 4;
    std::vector<NuisanceRow> rows = rows_at(place, true);
    const std::size_t first = rows.size();
    for (const FitParameter& parameter : freedom.parameters) rows.push_back({derivative(place, model, parameter)});
    const Metric metric(layout_, Part::train, rows, freedom.precision);
    std::vector<double> at(rows.size(), 0.0);  // where it is simulated, in standard deviations of priors
    double nearest = std::numeric_limits<double>::infinity();
    for (int k = 0; k < steps; ++k) {
      SensorModel moved = model;
      for (std::size_t p = 0; p < freedom.parameters.size(); ++p) {
        const FitParameter& parameter = freedom.parameters[p];
        double& value = value_in(moved, parameter.id, parameter.name).value;
        const double start = parameter.scaled(value);
        value = std::clamp(parameter.natural(start + at[first + p] * parameter.prior_sigma), parameter.lower,
                           parameter.upper);
        at[first + p] = (parameter.scaled(value) - start) / parameter.prior_sigma;
      }
      const Explained explained = metric.explain(difference(place, truth, moved), at);
      if (explained.chi >= nearest) break;
      nearest = explained.chi;
      std::copy(explained.values.begin() + static_cast<std::ptrdiff_t>(first), explained.values.end(),
                at.begin() + static_cast<std::ptrdiff_t>(first));
    }
    return nearest;
  }

  Freedom freedom(const LookAlike& model) const { return freedom_of(layout_, rows_, rung_, model); }

 private:
  /// What pose and lens do to a target's depth is nearly the same wherever it stands.
  std::vector<NuisanceRow> rows_at(const AdvisedCapture& place, bool with_lens) const {
    std::vector<NuisanceRow> result;
    for (const NuisanceRow& row : rows_) {
      if (row.capture != place.capture && !(row.capture < 0 && with_lens)) continue;
      result.push_back(row);
      for (const Block& block : layout_.blocks)
        if (block.capture != place.capture) std::fill_n(result.back().change.begin() + block.offset, block.size, 0.f);
    }
    return result;
  }

  Whitened difference(const AdvisedCapture& place, const SensorModel& one, const SensorModel& other) const {
    std::vector<StatVector> changes;
    for (std::uint64_t k = 0; k < seeds; ++k) {
      changes.push_back(experiment_.elsewhere(one, place.capture, place.where, seed_ + k, frames));
      const StatVector with_other = experiment_.elsewhere(other, place.capture, place.where, seed_ + k, frames);
      for (int j = 0; j < layout_.size; ++j) changes.back()[j] -= with_other[j];
    }
    fill_unknown(layout_, changes, true);
    std::vector<Whitened> by_seed;
    for (const StatVector& change : changes) by_seed.push_back(rung_.standard.difference(change));
    return shrunk(layout_, mean_over_seeds(layout_, by_seed), least_signal);
  }

  /// By one standard deviation of the parameter's prior.
  Whitened derivative(const AdvisedCapture& place, const SensorModel& model, const FitParameter& parameter) const {
    SensorModel moved = model;
    double& value = value_in(moved, parameter.id, parameter.name).value;
    const double before = parameter.scaled(value);
    value = std::clamp(parameter.natural(before + parameter.step), parameter.lower, parameter.upper);
    if (parameter.scaled(value) - before < 0.5 * parameter.step)  // at its upper bound
      value = std::clamp(parameter.natural(before - parameter.step), parameter.lower, parameter.upper);
    const double step = parameter.scaled(value) - before;
    if (step == 0) return Whitened(layout_.size, 0.f);
    Whitened slope = difference(place, moved, model);
    for (float& v : slope) v *= static_cast<float>(parameter.prior_sigma / step);
    return slope;
  }

  const Experiment& experiment_;
  const Layout& layout_;
  const Rung& rung_;
  const std::uint64_t seed_;
  const std::vector<NuisanceRow> rows_;
};

void keep_separating(std::vector<AdvisedCapture>& asked) {
  std::erase_if(asked, [](const AdvisedCapture& a) { return a.distance2 < far_enough; });
  std::stable_sort(asked.begin(), asked.end(),
                   [](const AdvisedCapture& a, const AdvisedCapture& b) { return a.distance2 > b.distance2; });
}

}  // namespace

std::vector<AdvisedCapture> captures_that_separate(const Experiment& experiment,
                                                   const std::vector<SceneMotion>& motions, const Rung& rung,
                                                   const LookAlike& one, const std::vector<LookAlike>& others,
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
  const Separator separator(experiment, motions, rung, seed);
  parallel_for(static_cast<int>(asked.size()), [&](int i) {
    asked[i].distance2 = std::numeric_limits<double>::infinity();
    for (const LookAlike& other : others)
      asked[i].distance2 = std::min(asked[i].distance2, separator.distance2(asked[i], one.model, other.model));
  });
  keep_separating(asked);
  asked.resize(std::min(asked.size(), most_asked));

  // Whichever is there, the other is fitted to the new capture, too.
  const Freedom of_one = separator.freedom(one);
  std::vector<Freedom> of_others;
  for (const LookAlike& other : others) of_others.push_back(separator.freedom(other));
  parallel_for(static_cast<int>(asked.size()), [&](int i) {
    for (std::size_t k = 0; k < others.size(); ++k) {
      const SensorModel& other = others[k].model;
      for (const double distance2 : {separator.distance2_fitted(asked[i], other, one.model, of_one),
                                     separator.distance2_fitted(asked[i], one.model, other, of_others[k])})
        asked[i].distance2 = std::min(asked[i].distance2, distance2);
    }
  });
  if (tracing())
    for (const AdvisedCapture& a : asked)
      fmt::print(stderr, "  {}: squared distance {:.0f}\n", a.where_to, a.distance2);
  keep_separating(asked);
  return asked;
}

}  // namespace binrig
