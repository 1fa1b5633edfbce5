#include "diagnose/screen.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <opencv2/core.hpp>

namespace binrig {
namespace {

constexpr int hats = 10;                    // of a covariate's curve
constexpr int map_cols = 12, map_rows = 9;  // of a pattern fixed in the image
constexpr double pi = 3.14159265358979323846;

/// One cell of a map with its covariates.
struct Cell {
  bool train;
  float residual;  // whitened, nuisances taken out
  float change;    // stabilised units: measured less simulated
  double x, y;     // EFFECTS' image coordinates
  std::vector<double> covariates;
};

const std::vector<std::string> covariate_names{
    "z", "x", "y", "r2", "theta", "I", "distance to edge", "disparity phase"};
/// As a formula effect knows them; "" = it does not.
const std::vector<std::string> formula_names{"z", "x", "y", "r2", "theta", "I", "e", ""};

std::vector<Cell> cells_of(const Experiment& experiment, const Rung& rung, const StatVector& data,
                           const std::string& segment_name) {
  const Whitened& rest = rung.rest;
  std::vector<Cell> cells;
  for (const auto& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != segment_name) continue;
    const StatisticContext& context = experiment.context(block.capture);
    const Channels& nominal = experiment.nominal(block.capture);
    const auto light =
        experiment.forward().perfect(block.capture, 0, Offset{}, Channel::depth | Channel::diffuse, rung.model);
    const ImageCoordinates at(context.camera);
    const int side = (context.camera.width + block.cols - 1) / block.cols;
    for (int i = 0; i < block.size; ++i) {
      const int k = block.offset + i;
      if (rung.standard.spread()[k] == 0 || std::isnan(data[k])) continue;
      const int u = std::min(context.camera.width - 1, (i % block.cols) * side + side / 2);
      const int v = std::min(context.camera.height - 1, (i / block.cols) * side + side / 2);
      const double z = nominal.depth_mm.at<float>(v, u);
      if (z <= 0) continue;
      const double intensity =
          light->diffuse.empty() ? 0.4 : std::max(0.01, static_cast<double>(light->diffuse.at<float>(v, u)));
      const double disparity = context.focal_baseline / z;
      cells.push_back(
          {block.train,
           rest[k],
           data[k] - rung.standard.mean()[k],
           at.x(u),
           at.y(v),
           {z, at.x(u), at.y(v), at.r2(u, v),
            std::acos(std::min(1.0, static_cast<double>(nominal.cos_incidence.at<float>(v, u)))), std::log(intensity),
            static_cast<double>(nominal.edge_px.at<float>(v, u)), disparity - std::floor(disparity)}});
    }
  }
  return cells;
}

/// Held-out gain of predicting the residual by its train mean in each of a number of classes.
double class_gain(const std::vector<Cell>& cells, const std::vector<int>& classes, int count) {
  std::vector<double> sum(count, 0), number(count, 0);
  for (std::size_t i = 0; i < cells.size(); ++i)
    if (cells[i].train) sum[classes[i]] += cells[i].residual, number[classes[i]] += 1;
  double gain = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (cells[i].train) continue;
    const int c = classes[i];
    const double predicted = sum[c] / (number[c] + 2);  // a prior of unit variance about zero, twice
    gain += 2 * predicted * cells[i].residual - predicted * predicted;
  }
  return gain;
}

std::vector<int> covariate_classes(const std::vector<Cell>& cells, std::size_t covariate) {
  std::vector<double> sorted;
  for (const auto& cell : cells) sorted.push_back(cell.covariates[covariate]);
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> edges;
  for (int h = 1; h < hats; ++h) edges.push_back(sorted[sorted.size() * h / hats]);
  std::vector<int> classes;
  for (const auto& cell : cells)
    classes.push_back(
        static_cast<int>(std::upper_bound(edges.begin(), edges.end(), cell.covariates[covariate]) - edges.begin()));
  return classes;
}

struct Step {
  double angle = 0, offset = 0, gain = 0, height = 0;
};

/// The straight line in the image across which the residual jumps.
Step best_step(const std::vector<Cell>& cells) {
  Step best;
  std::vector<int> classes(cells.size());
  for (int a = 0; a < 24; ++a)
    for (int o = -9; o <= 9; ++o) {
      const double angle = a * pi / 24, offset = o * 0.09;
      for (std::size_t i = 0; i < cells.size(); ++i)
        classes[i] = cells[i].x * std::cos(angle) + cells[i].y * std::sin(angle) > offset;
      const double gain = class_gain(cells, classes, 2);
      if (gain <= best.gain) continue;
      double sum[2] = {0, 0}, count[2] = {0, 0};
      for (std::size_t i = 0; i < cells.size(); ++i) sum[classes[i]] += cells[i].change, count[classes[i]] += 1;
      best = {angle, offset, gain, count[0] > 0 && count[1] > 0 ? sum[1] / count[1] - sum[0] / count[0] : 0};
    }
  return best;
}

/// A parabola of the change over a covariate, as a formula effect's YAML.
std::string curve_formula(const std::vector<Cell>& cells, std::size_t covariate) {
  const std::string& name = formula_names[covariate];
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
  return fmt::format(
      "- formula: {{id: unexplained, stage: geometry, on: depth, expression: \"a0 + a1*{0} + a2*{0}^2\",\n"
      "    parameters: {{a0: {1:.4g}, a1: {2:.4g}, a2: {3:.4g}}}}}",
      variable, c[0], c[1], c[2]);
}

}  // namespace

void screen(const Experiment& experiment, const Rung& rung, const StatVector& data, std::vector<Unexplained>& entries) {
  for (auto& entry : entries) {
    const auto cells = cells_of(experiment, rung, data, entry.segment);
    if (cells.size() < 200) continue;
    double excess = 0;
    for (const auto& cell : cells)
      if (!cell.train) excess += static_cast<double>(cell.residual) * cell.residual;
    excess *= std::max(0.0, 1 - 1 / std::max(1.0, entry.ratio));  // beyond the model's own randomness
    if (excess <= 0) continue;

    std::vector<std::pair<double, std::size_t>> gains;
    for (std::size_t k = 0; k < covariate_names.size(); ++k)
      gains.emplace_back(class_gain(cells, covariate_classes(cells, k), hats), k);
    std::sort(gains.rbegin(), gains.rend());
    std::vector<int> places;
    for (const auto& cell : cells) {
      const int col = std::clamp(static_cast<int>((cell.x + 1) / 2 * map_cols), 0, map_cols - 1);
      const int row = std::clamp(static_cast<int>((cell.y + 0.75) / 1.5 * map_rows), 0, map_rows - 1);
      places.push_back(row * map_cols + col);
    }
    const double map_gain = class_gain(cells, places, map_cols * map_rows);
    const Step step = best_step(cells);
    const double best = std::max({map_gain, step.gain, gains[0].first});
    if (best < 20) continue;  // nothing goes with it
    entry.share = std::clamp(best / excess, 0.0, 1.0);
    for (const auto& [gain, k] : gains)
      if (gain > 0.3 * best && entry.covariates.size() < 3) entry.covariates.push_back(covariate_names[k]);
    const bool depth = entry.segment == "bias";
    if (step.gain > 0.7 * best) {
      entry.shape =
          fmt::format("a step across a straight line in the image, normal at {:.0f} deg", step.angle * 180 / pi);
      if (depth) {
        entry.shape += fmt::format(", {:.2g} mm high", step.height);
        entry.formula = fmt::format(
            "- formula: {{id: unexplained, stage: geometry, on: depth,\n"
            "    expression: \"a*(x*{:.4f} + y*{:.4f} > {:.3f})\", parameters: {{a: {:.4g}}}}}",
            std::cos(step.angle), std::sin(step.angle), step.offset, step.height);
      }
      if (entry.covariates.empty()) entry.covariates = {"x", "y"};
    } else if (map_gain > 1.3 * gains[0].first) {
      entry.shape = "a pattern fixed in the image";
      if (entry.covariates.empty()) entry.covariates = {"x", "y"};
    } else {
      entry.shape = "a curve over " + covariate_names[gains[0].second];
      if (depth) entry.formula = curve_formula(cells, gains[0].second);
    }
  }
}

}  // namespace binrig
