// Lateral noise: where in the image a depth is found is itself uncertain.
//
//   z'(u, v) = z((u, v) + n),   n ~ N(0, sigma^2) along each axis, a pixel and frame
//
// Between pixels of one surface the look-up is bilinear; across a depth edge (neighbours that differ by more than 8 mm)
// it takes the nearest pixel, so that edges jitter and stay sharp. An invalid look-up leaves the pixel as it is.
#include <algorithm>

#include "sim/effect.h"

namespace binrig::effects {
namespace {

float looked_up(const cv::Mat& depth, const cv::Mat& reason, float u, float v, float fallback) {
  u = std::clamp(u, 0.f, static_cast<float>(depth.cols - 1));
  v = std::clamp(v, 0.f, static_cast<float>(depth.rows - 1));
  const int col = std::min(static_cast<int>(u), depth.cols - 2), row = std::min(static_cast<int>(v), depth.rows - 2);
  if (col < 0 || row < 0) return fallback;
  const float a = u - col, b = v - row;
  const float *z0 = depth.ptr<float>(row) + col, *z1 = depth.ptr<float>(row + 1) + col;
  const std::uint8_t *r0 = reason.ptr<std::uint8_t>(row) + col, *r1 = reason.ptr<std::uint8_t>(row + 1) + col;
  const bool all_valid = (r0[0] | r0[1] | r1[0] | r1[1]) == 0;
  if (all_valid && std::max({z0[0], z0[1], z1[0], z1[1]}) - std::min({z0[0], z0[1], z1[0], z1[1]}) <= 8.f) {
    const float upper = z0[0] + a * (z0[1] - z0[0]), lower = z1[0] + a * (z1[1] - z1[0]);
    return upper + b * (lower - upper);
  }
  const int i = a > 0.5f, j = b > 0.5f;
  return (j ? r1 : r0)[i] == 0 ? (j ? z1 : z0)[i] : fallback;
}

}  // namespace

const Effect& lateral_noise() {
  static const Effect effect{
      {.name = "lateral_noise",
       .phenomenon = "Edges jitter and slopes are noisier than planes.",
       .stage = Stage::matching,
       .formula = "z'(u, v) = z((u, v) + n), n ~ N(0, sigma^2) along each axis, a pixel and frame",
       .citation = "Nguyen, Izadi and Lovell, Modeling Kinect sensor noise for improved 3D reconstruction and "
                   "tracking, 3DIMPVT 2012",
       .deviation = "their sigma depends on the incidence; ours is one number, incidence_noise carries the rest",
       .parameters = {{.name = "sigma",
                       .unit = "px",
                       .lower = 0,
                       .upper = 4,
                       .typical_low = 0.2,
                       .typical_high = 1.2,
                       .neutral = 0.0,
                       .initial = 0.5,
                       .meaning = "standard deviation of the place"}},
       .neighbourhood_px = 25,
       .amplitude = "sigma",
       .revealed_by = "repeated frames of a tilted plane with a step"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float sigma = static_cast<float>(instance.value("sigma"));
        const CaptureContext* capture = &context;
        return stateless([=](Layers& layers, const Channels&, const FrameInstant& instant) {
          const cv::Size size = layers.depth_mm.size();
          const RandomStream draws = capture->draws(instant.number);
          cv::Mat du(size, CV_32F), dv(size, CV_32F);
          draws.child("u").fill_normal(du);
          draws.child("v").fill_normal(dv);
          const cv::Mat depth = layers.depth_mm.clone();
          for_rows(size, [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              float* z = layers.depth_mm.ptr<float>(row);
              for (int col = 0; col < size.width; ++col) {
                if (!layers.valid(row, col)) continue;
                const float u = col + sigma * du.at<float>(row, col), v = row + sigma * dv.at<float>(row, col);
                z[col] = looked_up(depth, layers.reason, u, v, z[col]);
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
