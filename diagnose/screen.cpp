#include "diagnose/screen.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "diagnose/cells.h"
#include "diagnose/trace.h"
#include "diagnose/unit_map.h"

namespace binrig {
namespace {

constexpr int hats = 10;                    // of a covariate's curve
constexpr int map_cols = 12, map_rows = 9;  // of a pattern fixed in the image
constexpr double least_share = 0.02;        // of what is left, that a shape has to explain to be spoken of
constexpr double pi = 3.14159265358979323846;

Eigen::VectorXd products(const std::vector<Whitened>& changes, const Whitened& residual) {
  Eigen::VectorXd result(changes.size());
  for (int k = 0; k < result.size(); ++k) result[k] = dot(changes[k], residual);
  return result;
}

/// Shapes in the statistics that are fitted to the residual on train, as hypotheses are: whitened like it, with what
/// poses, lens and the model's own parameters could make of them taken out.
struct Shapes {
  std::vector<Whitened> changes_on_train, changes_on_test;
  Eigen::MatrixXd train, test;  ///< Gram matrices of these
  Eigen::VectorXd on_train, on_test;

  /// Coefficients from train, about zero with a prior worth two cells of unit variance.
  Eigen::VectorXd coefficients(const Eigen::VectorXd& of_train) const {
    Eigen::MatrixXd a = train;
    a.diagonal().array() += 2;
    return a.ldlt().solve(of_train);
  }
  double heldout_gain() const {
    const Eigen::VectorXd c = coefficients(on_train);
    return 2 * c.dot(on_test) - c.dot(test * c);
  }
  /// By how many standard deviations of chance a residual of the captures held out agrees with what it says of the
  /// shapes on train. A standard normal number where the two have nothing in common but chance.
  double agreement(const Whitened& residual) const {
    const Eigen::VectorXd c = coefficients(products(changes_on_train, residual));
    const double variance = c.dot(test * c);
    return variance > 0 ? c.dot(products(changes_on_test, residual)) / std::sqrt(variance) : 0;
  }
};

/// One shape a column: value(cell, shape) in stabilised units.
Shapes shapes_of(const Experiment& experiment, const Rung& rung, const std::vector<MapCell>& cells, int count,
                 const std::function<double(const MapCell&, int)>& value) {
  Shapes shapes;
  auto &train = shapes.changes_on_train, &test = shapes.changes_on_test;
  train.resize(count), test.resize(count);
  parallel_for(count, [&](int k) {
    StatVector raw(experiment.layout().size, 0.f);
    for (const MapCell& cell : cells) raw[cell.index] = static_cast<float>(value(cell, k));
    const Whitened change = rung.standard.difference(raw);
    train[k] = rung.train.apply(change);
    test[k] = rung.test.apply(change);
    for (std::size_t i = 0; i < rung.rest.size(); ++i) {
      const float slope = compression_slope(rung.rest[i]);
      train[k][i] *= slope, test[k][i] *= slope;
    }
  });
  shapes.train.resize(count, count);
  shapes.test.resize(count, count);
  parallel_for(count, [&](int k) {
    for (int j = 0; j <= k; ++j) {
      shapes.train(k, j) = shapes.train(j, k) = dot(train[k], train[j]);
      shapes.test(k, j) = shapes.test(j, k) = dot(test[k], test[j]);
    }
  });
  shapes.on_train = products(train, rung.rest);
  shapes.on_test = products(test, rung.rest);
  return shapes;
}

/// A covariate cut into classes of equal number.
Shapes curve(const Experiment& experiment, const Rung& rung, const std::vector<MapCell>& cells, std::size_t covariate) {
  std::vector<double> sorted;
  for (const auto& cell : cells) sorted.push_back(cell.covariates[covariate]);
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> edges;
  for (int h = 1; h < hats; ++h) edges.push_back(sorted[sorted.size() * h / hats]);
  return shapes_of(experiment, rung, cells, hats, [&](const MapCell& cell, int k) {
    return std::upper_bound(edges.begin(), edges.end(), cell.covariates[covariate]) - edges.begin() == k ? 1. : 0.;
  });
}

Shapes map_in_the_image(const Experiment& experiment, const Rung& rung, const std::vector<MapCell>& cells) {
  return shapes_of(experiment, rung, cells, map_cols * map_rows, [](const MapCell& cell, int k) {
    const int col = std::clamp(static_cast<int>((cell.x + 1) / 2 * map_cols), 0, map_cols - 1);
    const int row = std::clamp(static_cast<int>((cell.y + 0.75) / 1.5 * map_rows), 0, map_rows - 1);
    return row * map_cols + col == k ? 1. : 0.;
  });
}

struct Step {
  double angle = 0, offset = 0, gain = 0, height = 0;
};

/// The straight line in the image across which the residual jumps: sought on a grid, then closer about the best.
Step best_step(const Experiment& experiment, const Rung& rung, const std::vector<MapCell>& cells) {
  Step best;
  const auto look = [&](const std::vector<Step>& lines) {
    std::vector<Step> found = lines;
    const Shapes all =
        shapes_of(experiment, rung, cells, static_cast<int>(lines.size()), [&](const MapCell& cell, int k) {
          return cell.x * std::cos(lines[k].angle) + cell.y * std::sin(lines[k].angle) > lines[k].offset ? 1. : 0.;
        });
    for (std::size_t k = 0; k < lines.size(); ++k) {
      const int i = static_cast<int>(k);
      const double height = all.on_train[i] / (all.train(i, i) + 2);
      const double gain = 2 * height * all.on_test[i] - height * height * all.test(i, i);
      if (gain > best.gain) best = {lines[k].angle, lines[k].offset, gain, height};
    }
  };
  std::vector<Step> lines;
  for (int a = 0; a < 12; ++a)
    for (int o = -4; o <= 4; ++o) lines.push_back({a * pi / 12, o * 0.18});
  look(lines);
  for (double width : {1.0, 0.3, 0.1}) {
    const Step centre = best;
    lines.clear();
    for (int a = -2; a <= 2; ++a)
      for (int o = -2; o <= 2; ++o)
        lines.push_back({centre.angle + a * width * pi / 30, centre.offset + o * width * 0.06});
    look(lines);
  }
  return best;
}

/// A formula effect's YAML, to be pasted into the model: one that was pasted before keeps its id.
std::string formula_effect(const SensorModel& model, const std::string& expression, const std::string& parameters) {
  return fmt::format(
      "- formula: {{id: {}, stage: geometry, on: depth, expression: \"{}\",\n"
      "    parameters: {{{}}}}}",
      free_id(model, "unexplained"), expression, parameters);
}

std::string step_formula(const SensorModel& model, const Step& step, double height) {
  return formula_effect(
      model, fmt::format("a*(x*{:.4f} + y*{:.4f} > {:.3f})", std::cos(step.angle), std::sin(step.angle), step.offset),
      fmt::format("a: {:.4g}", height));
}

/// A model with a formula effect as a user would paste it.
SensorModel with_formula(SensorModel model, const std::string& formula, const EffectCatalogue& catalogue) {
  add_effect(model, catalogue,
             parse_sensor_model("name: pasted\neffects:\n" + formula, "pasted", catalogue).effects[0]);
  return model;
}

/// Height of a step where nothing is compressed: chi on train is least. What it makes of the bias is simulated: what
/// blurs the depth blurs the step, and whitened sharply it would seem lower.
double step_height(const Experiment& experiment, const Rung& rung, const Step& step) {
  constexpr int seeds = 4;
  std::vector<Trial> trials;
  for (std::uint64_t k = 0; k < seeds; ++k)
    for (const SensorModel& model :
         {with_formula(rung.model, step_formula(rung.model, step, step.height), experiment.forward().catalogue()),
          rung.model})
      trials.push_back({model, rung.offsets, k + 1});
  const auto simulated = experiment.simulate(trials, "simulating the formula");
  StatVector raw(experiment.layout().size, 0.f);
  for (const Block& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != "bias") continue;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      for (int k = 0; k < seeds; ++k)
        raw[i] += (simulated[2 * k][i] - simulated[2 * k + 1][i]) / static_cast<float>(seeds * step.height);
  }
  const Whitened change = rung.standard.difference(raw);
  const auto chi = [&](double height) {
    Whitened y = rung.data;
    for (std::size_t i = 0; i < y.size(); ++i) y[i] -= static_cast<float>(height) * change[i];
    return rung.train.explain(y, rung.place).chi;
  };
  double low = std::min(0.0, 3 * step.height), high = std::max(0.0, 3 * step.height);
  constexpr double golden = 0.6180339887;
  for (int k = 0; k < 16; ++k) {
    const double a = high - golden * (high - low), b = low + golden * (high - low);
    (chi(a) < chi(b) ? high : low) = chi(a) < chi(b) ? b : a;
  }
  return (low + high) / 2;
}

/// A parabola of the change over a covariate.
std::string curve_formula(const SensorModel& model, const std::vector<MapCell>& cells, std::size_t covariate) {
  const std::string& name = covariates()[covariate].in_formulas;
  if (name.empty()) return "";
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const auto& cell : cells) {
    if (!cell.train) continue;
    const double s = cell.covariates[covariate];
    const Eigen::Vector3d row(1, s, s * s);
    a += row * row.transpose();
    b += row * cell.change;
  }
  a.diagonal().array() += 1e-9;
  const Eigen::Vector3d c = a.ldlt().solve(b);
  const std::string variable = name == "I" ? "ln(I)" : name;
  return formula_effect(model, fmt::format("a0 + a1*{0} + a2*{0}^2", variable),
                        fmt::format("a0: {:.4g}, a1: {:.4g}, a2: {:.4g}", c[0], c[1], c[2]));
}

/// Gains on captures held out of everything that a map's remainder is held against.
struct ShapeGains {
  std::vector<std::pair<double, std::size_t>> curves;  ///< best first; index of the covariate
  double map = 0;
  Step step;
};

ShapeGains gains_of_shapes(const Experiment& experiment, const Rung& rung, const std::vector<MapCell>& cells) {
  ShapeGains gains;
  for (std::size_t k = 0; k < covariates().size(); ++k)
    gains.curves.emplace_back(curve(experiment, rung, cells, k).heldout_gain(), k);
  std::sort(gains.curves.rbegin(), gains.curves.rend());
  gains.map = map_in_the_image(experiment, rung, cells).heldout_gain();
  gains.step = best_step(experiment, rung, cells);
  return gains;
}

}  // namespace

bool has_simple_shape(const Experiment& experiment, const Rung& rung, const StatVector& data) {
  const auto cells = cells_of(experiment, rung, data, "bias");
  if (cells.size() < 200) return false;
  const ShapeGains gains = gains_of_shapes(experiment, rung, cells);
  const double simple = std::max(gains.step.gain, gains.curves[0].first);
  if (tracing()) fmt::print(stderr, "  bias: a simple shape gains {:.0f}, a pattern {:.0f}\n", simple, gains.map);
  return simple > 0.7 * gains.map;
}

bool bias_goes_with_something(const Experiment& experiment, const Rung& rung, const StatVector& data) {
  constexpr double beyond_chance = 6;  // standard deviations, as for squares
  const auto cells = cells_of(experiment, rung, data, "bias");
  if (cells.size() < 200) return false;
  std::vector<Whitened> nulls;
  const auto goes_with = [&](const std::string& what, const Shapes& shapes) {
    const double z = shapes.agreement(rung.rest);
    if (tracing()) fmt::print(stderr, "  bias goes with {} by {:.2f}\n", what, z);
    if (z <= beyond_chance) return false;
    // Each null is of another unit, whose maps all of its captures have in common.
    if (nulls.empty()) nulls = left_of_nulls(rung);
    std::vector<double> chance(nulls.size());
    parallel_for(static_cast<int>(nulls.size()), [&](int k) { chance[k] = shapes.agreement(nulls[k]); });
    double square = 0;
    for (const double of_null : chance) square += of_null * of_null / static_cast<double>(nulls.size());
    if (tracing()) fmt::print(stderr, "  the model's own units do by {:.2f}\n", std::sqrt(square));
    return z > beyond_chance * std::sqrt(square);
  };
  if (goes_with("place in the image", map_in_the_image(experiment, rung, cells))) return true;
  for (std::size_t k = 0; k < covariates().size(); ++k)
    if (goes_with(covariates()[k].name, curve(experiment, rung, cells, k))) return true;
  return false;
}

void screen(const Experiment& experiment, const Rung& rung, const StatVector& data, std::vector<Unexplained>& entries) {
  for (auto& entry : entries) {
    const auto cells = cells_of(experiment, rung, data, entry.segment);
    if (cells.size() < 200) continue;
    double excess = 0;
    for (const auto& cell : cells)
      if (!cell.train) excess += static_cast<double>(cell.residual) * cell.residual;
    excess *= std::max(0.0, 1 - 1 / std::max(1.0, entry.ratio));  // beyond the model's own randomness
    if (excess <= 0) continue;

    const auto [gains, map, step] = gains_of_shapes(experiment, rung, cells);
    const double best = std::max({map, step.gain, gains[0].first});
    if (tracing()) {
      fmt::print(stderr,
                 "screen {}: excess {:.0f}, map {:.0f}, step {:.0f} (angle {:.3f}, offset {:.3f}, height {:.3f})",
                 entry.segment, excess, map, step.gain, step.angle, step.offset, step.height);
      for (const auto& [gain, k] : gains) fmt::print(stderr, ", {} {:.0f}", covariates()[k].name, gain);
      fmt::print(stderr, "\n");
    }
    if (best < std::max(20.0, least_share * excess)) continue;  // nothing goes with it
    entry.share = std::clamp(best / excess, 0.0, 1.0);
    for (const auto& [gain, k] : gains)
      if (gain > 0.3 * best && entry.covariates.size() < 3) entry.covariates.push_back(covariates()[k].name);
    const bool depth = entry.segment == "bias";
    if (step.gain > 0.7 * best) {
      entry.shape =
          fmt::format("a step across a straight line in the image, normal at {:.0f} deg", step.angle * 180 / pi);
      if (depth) {
        const double height = step_height(experiment, rung, step);
        entry.shape += fmt::format(", {:.2g} mm high", std::abs(height));
        entry.formula = step_formula(rung.model, step, height);
      }
      if (entry.covariates.empty()) entry.covariates = {"x", "y"};
    } else if (map > 1.3 * gains[0].first) {
      entry.shape = "a pattern fixed in the image";
      if (entry.covariates.empty()) entry.covariates = {"x", "y"};
    } else {
      entry.shape = "a curve over " + covariates()[gains[0].second].name;
      if (depth) entry.formula = curve_formula(rung.model, cells, gains[0].second);
    }
  }
}

}  // namespace binrig
