// A map of cells by its discrete cosine transform, in rings of frequency.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace binrig {

using CosineTransform = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Orthonormal; element (i, j) is the cosine of i half periods down and j across. `map`: row by row, `cols` wide.
CosineTransform transform(const std::vector<double>& map, int cols);

/// The map (row by row, `cols` wide) under a Hann window along its rows or its columns, of unit mean square: the
/// scatter of its cosines stays, what does not close at those borders leaks nowhere, and what is constant along the
/// other direction stays so.
std::vector<double> taper(std::vector<double> map, int cols, bool along_rows);

/// Ring of a cosine; -1 for the constant. The first ring goes to where each side has four cosines.
int ring_of(int row, int col, int rows, int cols);

/// Number of cosines in each ring.
std::vector<double> modes_of(int rows, int cols);

/// Squares of a map's cosines, by ring.
using RingSquares = std::vector<std::vector<double>>;
RingSquares squares_by_ring(const std::vector<double>& map, int cols);

}  // namespace binrig
