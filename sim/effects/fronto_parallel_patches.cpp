// Fronto-parallel patches: the sensor measures depth at points strewn over the image (projected dots, centres of
// matching windows) and holds it around them, noise and all, so that a slope becomes stairs that face the camera.
//
//   z'(u) = z(u) + hold ((1 - slant) (z(d) - z(u)) + n(d) - n(u)),   d the nearest of the points
//
// One point in each square of `pitch`, anywhere in it. A sensor that measures a part of the slope at each point, too,
// has a slant. On a slope the error is |grad z| hold (1 - slant) pitch / 3 in standard deviation, goes together less
// far along the slope than across it, and is skewed: small steps one way, jumps back. A patch ends at a depth edge.
// Which point lies where depends on the distance of what it falls on, so that every capture has points of its own; they
// stay through the capture.
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "sim/effect.h"

namespace binrig::effects {
namespace {

/// CV_32SC2: column and row of the point nearest to each pixel.
cv::Mat nearest_points(cv::Size size, double pitch, const RandomStream& draws) {
  const RandomStream across = draws.child("u"), down = draws.child("v");
  cv::Mat away(size, CV_8U, cv::Scalar(1));
  std::vector<cv::Point> points;
  const int half_cols = static_cast<int>(size.width / (2 * pitch)) + 1,
            half_rows = static_cast<int>(size.height / (2 * pitch)) + 1;
  for (int j = -half_rows; j <= half_rows; ++j)
    for (int i = -half_cols; i <= half_cols; ++i) {
      // By place in the lattice, so that another pitch moves the points and draws no others.
      const std::uint64_t cell =
          (static_cast<std::uint64_t>(j + 0x8000) << 16) + static_cast<std::uint64_t>(i + 0x8000);
      const cv::Point at(static_cast<int>(std::floor(0.5 * size.width + pitch * (i - across.uniform(cell)))),
                         static_cast<int>(std::floor(0.5 * size.height + pitch * (j - down.uniform(cell)))));
      if (!cv::Rect({}, size).contains(at)) continue;
      away.at<std::uint8_t>(at) = 0;
      points.push_back(at);
    }
  if (points.empty()) {  // an image smaller than a patch
    points.emplace_back(size.width / 2, size.height / 2);
    away.at<std::uint8_t>(points[0]) = 0;
  }
  cv::Mat distance, label, nearest(size, CV_32SC2);
  cv::distanceTransform(away, distance, label, cv::DIST_L2, cv::DIST_MASK_5, cv::DIST_LABEL_PIXEL);
  std::vector<cv::Point> of_label(points.size() + 1);
  for (const cv::Point& at : points) of_label[label.at<int>(at)] = at;
  for (int row = 0; row < size.height; ++row)
    for (int col = 0; col < size.width; ++col) nearest.at<cv::Point>(row, col) = of_label[label.at<int>(row, col)];
  return nearest;
}

}  // namespace

const Effect& fronto_parallel_patches() {
  static const Effect effect{
      {.name = "fronto_parallel_patches",
       .phenomenon = "Slopes become stairs: patches of depth face the camera.",
       .stage = Stage::noise,
       .formula =
           "z'(u) = z(u) + hold ((1 - slant) (z(d) - z(u)) + n(d) - n(u)); d = the nearest of points strewn over "
           "the image, one in each square of pitch",
       .citation = "the assumption that depth is constant in a window: Scharstein and Szeliski, A taxonomy and "
                   "evaluation of dense two-frame stereo correspondence algorithms, IJCV 2002; of projected dots: "
                   "our finding on Apple TrueDepth cameras",
       .deviation = "points are strewn anew in each capture, where real ones move with the disparity",
       .parameters = {{.name = "hold",
                       .unit = "1",
                       .lower = 0,
                       .upper = 1,
                       .typical_low = 0.1,
                       .typical_high = 1,
                       .neutral = 0.0,
                       .initial = 0.4,
                       .meaning = "how much of a patch has what was measured at its point"},
                      {.name = "slant",
                       .unit = "1",
                       .lower = 0,
                       .upper = 1,
                       .typical_low = 0,
                       .typical_high = 0.8,
                       .initial = 0.4,
                       .meaning = "how much of a patch's slope is measured, too"},
                      {.name = "pitch",
                       .unit = "px",
                       .lower = 1,
                       .upper = 25,
                       .typical_low = 2,
                       .typical_high = 10,
                       .initial = 5,
                       .log_scaled = true,
                       .meaning = "mean distance of the points"}},
       .reads = Channel::depth | Channel::edge_distance,
       .neighbourhood_px = 75,
       .amplitude = "hold",
       .per_capture_map = true,
       .revealed_by = "planes at several tilts"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const auto hold = static_cast<float>(instance.value("hold")),
                   of_slope = static_cast<float>(hold * (1 - instance.value("slant")));
        const cv::Mat nearest = nearest_points({context.camera.width, context.camera.height}, instance.value("pitch"),
                                               context.capture_draws());
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          const cv::Mat depth = layers.depth_mm.clone(), noise = layers.noise_mm.clone();
          for_rows(depth.size(), [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              const cv::Point* points = nearest.ptr<cv::Point>(row);
              const float* edge = channels.edge_px.ptr<float>(row);
              float *z = layers.depth_mm.ptr<float>(row), *n = layers.noise_mm.ptr<float>(row);
              for (int col = 0; col < depth.cols; ++col) {
                const cv::Point d = points[col];
                const auto away = static_cast<float>((d - cv::Point(col, row)).dot(d - cv::Point(col, row)));
                if (away >= edge[col] * edge[col] || !layers.valid(row, col) || !layers.valid(d.y, d.x)) continue;
                z[col] += of_slope * (depth.at<float>(d) - z[col]);
                n[col] += hold * (noise.at<float>(d) - n[col]);
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
