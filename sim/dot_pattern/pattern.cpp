#include "sim/dot_pattern/pattern.h"

#include <algorithm>
#include <cmath>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "core/random.h"

namespace binrig::dot_pattern {
namespace {

constexpr int samples_per_px = 4;
constexpr int margin_px = 24;

// Places at least `closest` apart in a torus of width x height, thrown at random until the wanted number is there or
// hardly any room is left.
std::vector<cv::Point2d> throw_darts(double width, double height, double closest, std::size_t wanted,
                                     const RandomStream& stream) {
  const int cols = std::max(1, static_cast<int>(width / closest)),
            rows = std::max(1, static_cast<int>(height / closest));
  const double cell_x = width / cols, cell_y = height / rows;  // not smaller than `closest`: nine cells to look at
  std::vector<std::vector<cv::Point2d>> cells(static_cast<std::size_t>(cols) * rows);
  std::vector<cv::Point2d> dots;
  for (std::uint64_t dart = 0; dots.size() < wanted && dart < 12 * wanted; ++dart) {
    const cv::Point2d place(stream.uniform(2 * dart) * width, stream.uniform(2 * dart + 1) * height);
    const int col = std::min(cols - 1, static_cast<int>(place.x / cell_x)),
              row = std::min(rows - 1, static_cast<int>(place.y / cell_y));
    bool room = true;
    for (int dr = -1; dr <= 1 && room; ++dr) {
      for (int dc = -1; dc <= 1 && room; ++dc) {
        for (const cv::Point2d& other : cells[((row + dr + rows) % rows) * cols + (col + dc + cols) % cols]) {
          const double dx = std::remainder(other.x - place.x, width), dy = std::remainder(other.y - place.y, height);
          if (dx * dx + dy * dy < closest * closest) room = false;
        }
      }
    }
    if (!room) continue;
    cells[static_cast<std::size_t>(row) * cols + col].push_back(place);
    dots.push_back(place);
  }
  return dots;
}

}  // namespace

Pattern::Pattern(const Parameters& parameters, int first_column, int columns, int rows) {
  const double width = columns + 2 * margin_px, height = rows + 2 * margin_px;
  left_ = static_cast<float>(first_column - margin_px);
  top_ = static_cast<float>(-margin_px);
  raster_ = cv::Mat::zeros(static_cast<int>(height) * samples_per_px, static_cast<int>(width) * samples_per_px, CV_32F);
  const RandomStream stream = unit_stream(static_cast<std::uint64_t>(parameters.pattern_seed), "dot_pattern.dots");
  const double spacing = parameters.dot_spacing;
  const auto wanted = static_cast<std::size_t>(width * height / (spacing * spacing));
  const std::vector<cv::Point2d> dots = throw_darts(width, height, 0.6 * spacing, wanted, stream);
  const RandomStream brightness = stream.child("brightness");
  const double sigma = parameters.dot_sigma * samples_per_px;
  const int reach = static_cast<int>(std::ceil(4 * sigma));
  std::vector<double> along_x(2 * reach + 1), along_y(2 * reach + 1);
  for (std::size_t i = 0; i < dots.size(); ++i) {
    const double x = dots[i].x * samples_per_px, y = dots[i].y * samples_per_px;
    const double peak = (1 - parameters.background) * (1 - brightness.uniform(i) / 3);
    const int cx = static_cast<int>(std::floor(x)), cy = static_cast<int>(std::floor(y));
    for (int d = -reach; d <= reach; ++d) {
      const double across = (cx + d - x) / sigma;
      along_x[d + reach] = std::exp(-0.5 * across * across);
      along_y[d + reach] = peak * std::exp(-0.5 * (cy + d - y) * (cy + d - y) / (sigma * sigma));
    }
    for (int dy = -reach; dy <= reach; ++dy) {
      float* row = raster_.ptr<float>((cy + dy + raster_.rows) % raster_.rows);
      for (int dx = -reach; dx <= reach; ++dx) {
        row[(cx + dx + raster_.cols) % raster_.cols] += static_cast<float>(along_y[dy + reach] * along_x[dx + reach]);
      }
    }
  }
  raster_ += parameters.background;
}

float Pattern::at(float column, float row) const {
  float x = (column - left_) * samples_per_px, y = (row - top_) * samples_per_px;
  const float w = static_cast<float>(raster_.cols), h = static_cast<float>(raster_.rows);
  x -= w * std::floor(x / w);
  y -= h * std::floor(y / h);
  const int x0 = std::min(static_cast<int>(x), raster_.cols - 1), y0 = std::min(static_cast<int>(y), raster_.rows - 1);
  const int x1 = x0 + 1 == raster_.cols ? 0 : x0 + 1, y1 = y0 + 1 == raster_.rows ? 0 : y0 + 1;
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  const float* upper = raster_.ptr<float>(y0);
  const float* lower = raster_.ptr<float>(y1);
  const float above = upper[x0] + fx * (upper[x1] - upper[x0]), below = lower[x0] + fx * (lower[x1] - lower[x0]);
  return above + fy * (below - above);
}

cv::Mat Pattern::image(int first_column, int columns, int rows, double blur_px, int peak) const {
  const int margin = static_cast<int>(std::ceil(4 * blur_px)) + 1;
  cv::Mat sampled(rows + 2 * margin, columns + 2 * margin, CV_32F);
  parallel_for(sampled.rows, [&](int v) {
    for (int u = 0; u < sampled.cols; ++u) {
      float sum = 0;
      for (int j = 0; j < 4; ++j) {
        for (int i = 0; i < 4; ++i) {
          sum += at(static_cast<float>(first_column + u - margin) + (i - 1.5f) / 4,
                    static_cast<float>(v - margin) + (j - 1.5f) / 4);
        }
      }
      sampled.at<float>(v, u) = sum / 16;
    }
  });
  if (blur_px > 0) cv::GaussianBlur(sampled, sampled, cv::Size(2 * margin - 1, 2 * margin - 1), blur_px);
  cv::Mat counts;
  sampled(cv::Rect(margin, margin, columns, rows)).convertTo(counts, CV_16U, peak);
  return counts;
}

}  // namespace binrig::dot_pattern
