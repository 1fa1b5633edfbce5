// Hole filling: the driver closes small holes with what stands nearest, and smears edges over their shadows.
//
//   an invalid pixel takes the depth of the nearest valid pixel within reach
//
// Of equally near ones the upper, then the left one.
#include <algorithm>
#include <tuple>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "sim/effect.h"

namespace binrig::effects {
namespace {

std::vector<cv::Point> by_distance(int reach) {
  std::vector<cv::Point> offsets;
  for (int y = -reach; y <= reach; ++y) {
    for (int x = -reach; x <= reach; ++x) {
      const int square = x * x + y * y;
      if (square > 0 && square <= reach * reach) offsets.emplace_back(x, y);
    }
  }
  std::sort(offsets.begin(), offsets.end(), [](const cv::Point& a, const cv::Point& b) {
    return std::tuple(a.dot(a), a.y, a.x) < std::tuple(b.dot(b), b.y, b.x);
  });
  return offsets;
}

}  // namespace

const Effect& hole_filling() {
  static const Effect effect{
      {.name = "hole_filling",
       .phenomenon = "Holes are smaller than they should be and filled with their surroundings.",
       .stage = Stage::spatial,
       .formula = "an invalid pixel takes the depth of the nearest valid pixel within reach",
       .citation =
           "plain nearest-neighbour filling, as drivers offer it (a filter of librealsense, a setting of others)",
       .deviation = "",
       .parameters = {{.name = "reach",
                       .unit = "px",
                       .lower = 0,
                       .upper = 20,
                       .typical_low = 1,
                       .typical_high = 6,
                       .neutral = 0.0,
                       .initial = 2,
                       .kind = ParameterKind::integer,
                       .interpolate = false,
                       .meaning = "how far a depth is carried into a hole"}},
       .neighbourhood_px = 20,
       .amplitude = "reach",
       .may_clear = true,
       .revealed_by = "a box on a plane: its shadow; a black spot"},
      [](const EffectInstance& instance, const CaptureContext&) -> std::unique_ptr<Run> {
        const int reach = static_cast<int>(instance.value("reach"));
        return stateless([reach, offsets = by_distance(reach)](Layers& layers, const Channels&, const FrameInstant&) {
          const cv::Size size = layers.depth_mm.size();
          const cv::Mat valid = layers.reason == static_cast<int>(Reason::measured), depth = layers.depth_mm.clone();
          // Cheap first: what lies within a square of a valid pixel at all.
          cv::Mat near;
          cv::dilate(valid, near, cv::Mat::ones(2 * reach + 1, 2 * reach + 1, CV_8U));
          for_rows(size, [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              for (int col = 0; col < size.width; ++col) {
                if (valid.at<std::uint8_t>(row, col) || !near.at<std::uint8_t>(row, col)) continue;
                for (const cv::Point& step : offsets) {
                  const int y = row + step.y, x = col + step.x;
                  if (y < 0 || y >= size.height || x < 0 || x >= size.width || !valid.at<std::uint8_t>(y, x)) continue;
                  layers.depth_mm.at<float>(row, col) = depth.at<float>(y, x);
                  layers.reason.at<std::uint8_t>(row, col) = static_cast<std::uint8_t>(Reason::measured);
                  break;
                }
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
