#include "diagnose/map_rings.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace binrig {
namespace {

/// Orthonormal cosines, row by row.
Eigen::MatrixXd cosines(int n) {
  Eigen::MatrixXd m(n, n);
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < n; ++i)
      m(k, i) = std::sqrt((k == 0 ? 1.0 : 2.0) / n) * std::cos(std::numbers::pi * k * (i + 0.5) / n);
  return m;
}

/// Of unit mean square.
double hann(int i, int n) { return std::sqrt(2.0 / 3) * (1 - std::cos(2 * std::numbers::pi * (i + 0.5) / n)); }

}  // namespace

std::vector<double> taper(std::vector<double> map, int cols, bool along_rows) {
  const int rows = static_cast<int>(map.size()) / cols;
  for (int i = 0; i < rows * cols; ++i) map[i] *= along_rows ? hann(i % cols, cols) : hann(i / cols, rows);
  return map;
}

int ring_of(int row, int col, int rows, int cols) {
  if (row == 0 && col == 0) return -1;
  const double frequency = std::hypot(static_cast<double>(row) / rows, static_cast<double>(col) / cols);
  const double first = 3.5 / std::max(rows, cols);
  constexpr double ratio = 1.4;
  const int last = static_cast<int>(std::log(0.9 / first) / std::log(ratio));  // the corners go with it
  return frequency < first ? 0 : std::min(last, 1 + static_cast<int>(std::log(frequency / first) / std::log(ratio)));
}

std::vector<double> modes_of(int rows, int cols) {
  std::vector<double> modes;
  for (int i = 1; i < rows * cols; ++i) {
    const std::size_t ring = ring_of(i / cols, i % cols, rows, cols);
    if (ring >= modes.size()) modes.resize(ring + 1, 0);
    modes[ring] += 1;
  }
  return modes;
}

CosineTransform transform(const std::vector<double>& map, int cols) {
  const int rows = static_cast<int>(map.size()) / cols;
  return cosines(rows) * Eigen::Map<const CosineTransform>(map.data(), rows, cols) * cosines(cols).transpose();
}

RingSquares squares_by_ring(const std::vector<double>& map, int cols) {
  const CosineTransform cosines = transform(map, cols);
  const int rows = static_cast<int>(cosines.rows());
  RingSquares squares(modes_of(rows, cols).size());
  for (int row = 0; row < rows; ++row)
    for (int col = 0; col < cols; ++col)
      if (const int ring = ring_of(row, col, rows, cols); ring >= 0)
        squares[ring].push_back(cosines(row, col) * cosines(row, col));
  return squares;
}

}  // namespace binrig
