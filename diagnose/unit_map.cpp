#include "diagnose/unit_map.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>

#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int units = 4;
constexpr double least_coherence = 0.4;  // of a segment's change that is common to all captures
constexpr double strengths[] = {0.25, 0.5, 1, 2, 4};

double sum_of_squares(const std::vector<double>& map) {
  double sum = 0;
  for (double v : map) sum += v * v;
  return sum;
}

double kurtosis_of(const std::vector<double>& map) {
  double fourth = 0;
  for (double v : map) fourth += v * v * v * v;
  const double square = sum_of_squares(map);
  return square > 0 ? fourth * static_cast<double>(map.size()) / (square * square) : 3;
}

/// Mean product of adjacent cells over the mean square, of which `noise` (of the sum of squares) is none of the map's.
double neighbour_correlation(const std::vector<double>& map, int cols, double noise) {
  const int n = static_cast<int>(map.size());
  double product = 0;
  for (int i = 0; i < n; ++i) {
    if ((i + 1) % cols != 0) product += map[i] * map[i + 1];
    if (i + cols < n) product += map[i] * map[i + cols];
  }
  return product / 2 / std::max(1e-12, sum_of_squares(map) - noise);
}

}  // namespace

std::vector<Trial> UnitMap::trials_of(const Rung& rung, const SensorModel& model, std::uint64_t seed) {
  std::vector<Trial> trials;
  for (int k = 0; k < units; ++k)
    trials.push_back({model, rung.offsets, seed + static_cast<std::uint64_t>(k), Part::all, 2, true});
  return trials;
}

UnitMap::UnitMap(const Layout& layout, const Rung& rung, const std::vector<StatVector>& without,
                 const std::vector<StatVector>& with)
    : spread_(rung.standard.spread()) {
  std::vector<Whitened> change;
  for (std::size_t k = 0; k < with.size(); ++k) {
    StatVector difference(layout.size);
    for (int i = 0; i < layout.size; ++i) difference[i] = with[k][i] - without[k][i];
    change.push_back(rung.standard.difference(difference));
  }
  for (std::size_t s = 0; s < binrig::segments().size(); ++s) {
    std::vector<const Block*> blocks;
    for (const Block& block : layout.blocks)
      if (block.segment == static_cast<int>(s) && block.rows > 1 &&
          (blocks.empty() || (block.rows == blocks[0]->rows && block.cols == blocks[0]->cols)))
        blocks.push_back(&block);
    const int n = static_cast<int>(blocks.size());
    if (n < 2) continue;
    Segment segment;
    segment.name = binrig::segments()[s].name;
    segment.cells = blocks[0]->size;
    segment.cols = blocks[0]->cols;
    Eigen::MatrixXd moments = Eigen::MatrixXd::Zero(n, n);
    for (const Whitened& one : change)
      for (int a = 0; a < n; ++a)
        for (int b = 0; b <= a; ++b) {
          double sum = 0;
          for (int i = 0; i < segment.cells; ++i) sum += one[blocks[a]->offset + i] * one[blocks[b]->offset + i];
          moments(a, b) += sum / (segment.cells * static_cast<double>(change.size()));
        }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(moments);  // reads the lower half
    const double largest = solver.eigenvalues()[n - 1], trace = moments.trace();
    if (trace < 1e-4 || largest < least_coherence * trace) continue;
    const Eigen::VectorXd loading = solver.eigenvectors().col(n - 1) * std::sqrt(largest);
    for (int c = 0; c < n; ++c) segment.loadings.push_back({blocks[c]->offset, blocks[c]->train, loading[c]});

    double square = 0, known = 0;
    for (const auto& null : rung.nulls) {
      const Whitened rest = rung.train.explain(null).rest;
      for (const Block* block : blocks)
        for (int i = block->offset; block->train && i < block->offset + block->size; ++i)
          if (spread_[i] > 0) square += static_cast<double>(rest[i]) * rest[i], known += 1;
    }
    if (known == 0 || square <= 0) continue;
    segment.noise = square / known;
    segment.kurtosis = 0;
    for (const Whitened& one : change) {
      double unused = 0;
      const auto map = map_of(segment, one, unused);
      segment.kurtosis += kurtosis_of(map) / static_cast<double>(change.size());
      segment.neighbour += neighbour_correlation(map, segment.cols, 0) / static_cast<double>(change.size());
    }
    segments_.push_back(std::move(segment));
  }
}

void UnitMap::sums(const Segment& segment, int cell, const Whitened& rest, bool train, double& b, double& g) const {
  for (const Loading& loading : segment.loadings) {
    const int i = loading.offset + cell;
    if (loading.train != train || spread_[i] == 0) continue;
    b += loading.value * rest[i];
    g += loading.value * loading.value;
  }
}

std::vector<double> UnitMap::map_of(const Segment& segment, const Whitened& rest, double& noise) const {
  std::vector<double> map(segment.cells, 0);
  noise = 0;
  for (int i = 0; i < segment.cells; ++i) {
    double b = 0, g = 0;
    sums(segment, i, rest, true, b, g);
    sums(segment, i, rest, false, b, g);
    if (g == 0) continue;
    map[i] = b / g;
    noise += segment.noise / g;
  }
  return map;
}

UnitMap::Gain UnitMap::gain(const Whitened& train, const Whitened& test, const std::string& only_segment) const {
  Gain total;
  for (const Segment& segment : segments_) {
    if (!only_segment.empty() && segment.name != only_segment) continue;
    std::vector<double> b(segment.cells), g(segment.cells);
    for (int i = 0; i < segment.cells; ++i) sums(segment, i, train, true, b[i], g[i]);
    double best = 0, variance = 0;
    for (const double a : strengths) {
      double gain = 0;
      for (int i = 0; i < segment.cells; ++i) {
        const double share = a * a / (segment.noise + g[i] * a * a);
        gain += b[i] * b[i] * share - segment.noise * std::log1p(g[i] * a * a / segment.noise);
      }
      if (gain > best) best = gain, variance = a * a;
    }
    if (variance == 0) continue;
    total.train += best;
    for (int i = 0; i < segment.cells; ++i) {
      double on_test = 0, square = 0;
      sums(segment, i, test, false, on_test, square);
      const double value = b[i] * variance / (segment.noise + g[i] * variance);
      total.test += value * (2 * on_test - value * square);
    }
  }
  return total;
}

bool UnitMap::looks_random(const Whitened& rest) const {
  for (const Segment& segment : segments_) {
    double noise = 0;
    const auto map = map_of(segment, rest, noise);
    if (sum_of_squares(map) < 2 * noise) continue;  // too little of a map to judge it
    if (tracing())
      fmt::print(stderr, "  unit map: neighbours {:.2f} (units {:.2f}), kurtosis {:.1f} ({:.1f})\n",
                 neighbour_correlation(map, segment.cols, noise), segment.neighbour, kurtosis_of(map),
                 segment.kurtosis);
    constexpr double more_alike = 0.35;
    if (neighbour_correlation(map, segment.cols, noise) > segment.neighbour + more_alike) return false;
    const double kurtosis = kurtosis_of(map);
    // A wave has 1.5 and two levels have 1; a Gaussian map has 3, smooth ones (of few independent patches) 2 .. 4.
    if (kurtosis < 0.62 * std::min(segment.kurtosis, 5.0)) return false;
    if (segment.kurtosis < 5 && kurtosis > 1.7 * segment.kurtosis) return false;
  }
  return true;
}

}  // namespace binrig
