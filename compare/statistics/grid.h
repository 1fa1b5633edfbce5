// Sums of images over squares of pixels.
#pragma once

#include <vector>

#include "compare/statistic.h"

namespace binrig {

class Grid {
 public:
  Grid(const StatisticContext& context, int side_px)
      : side_(side_px), rows_(context.grid_rows(side_px)), cols_(context.grid_cols(side_px)) {}
  int side() const { return side_; }
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int size() const { return rows_ * cols_; }

  /// Adds image * mask (both CV_32F) square by square to sums.
  void add(const cv::Mat& image, const cv::Mat& mask, std::vector<double>& sums) const {
    std::vector<float> line(image.cols);
    for (int row = 0; row < rows_; ++row) {
      std::fill(line.begin(), line.end(), 0.f);
      for (int v = row * side_; v < std::min(image.rows, (row + 1) * side_); ++v) {
        const float *a = image.ptr<float>(v), *m = mask.ptr<float>(v);
        for (int u = 0; u < image.cols; ++u) line[u] += a[u] * m[u];
      }
      for (int col = 0; col < cols_; ++col) {
        float sum = 0;
        for (int u = col * side_; u < std::min(image.cols, (col + 1) * side_); ++u) sum += line[u];
        sums[row * cols_ + col] += sum;
      }
    }
  }

  /// sum / count as a map; unknown where fewer than `fewest` samples.
  RawStatistic means(const std::vector<double>& sums, const std::vector<double>& counts, double fewest) const {
    RawStatistic raw;
    raw.rows = rows_;
    raw.cols = cols_;
    raw.side_px = side_;
    raw.value.assign(size(), 0.f);
    raw.weight.assign(size(), 0.f);
    for (int i = 0; i < size(); ++i)
      if (counts[i] >= fewest && counts[i] > 0) {
        raw.value[i] = static_cast<float>(sums[i] / counts[i]);
        raw.weight[i] = static_cast<float>(counts[i]);
      }
    return raw;
  }

 private:
  int side_, rows_, cols_;
};

}  // namespace binrig
