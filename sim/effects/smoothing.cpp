// Smoothing: the sensor blurs its depth, edges included.
//
//   z' = sum of w z / sum of w over valid pixels,   w = Gaussian of the distance
#include <algorithm>

#include <opencv2/imgproc.hpp>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& smoothing() {
  static const Effect effect{
      {.name = "smoothing",
       .phenomenon = "Depth is blurred, edges included.",
       .stage = Stage::spatial,
       .formula = "z' = Gaussian-weighted mean of the valid depths around",
       .citation = "plain linear filter; over holes as normalised convolution (Knutsson and Westin, Normalized and "
                   "differential convolution, CVPR 1993)",
       .deviation = "",
       .parameters = {{.name = "sigma",
                       .unit = "px",
                       .lower = 0,
                       .upper = 10,
                       .typical_low = 0.4,
                       .typical_high = 2,
                       .neutral = 0.0,
                       .initial = 0.8,
                       .meaning = "standard deviation of the Gaussian"}},
       .neighbourhood_px = 40,
       .amplitude = "sigma",
       .revealed_by = "repeated frames of a plane with a step in view"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double sigma = instance.value("sigma");
        const float z0 = static_cast<float>(context.reference_distance_mm);
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          if (sigma <= 0) return;
          // Depths from z0 keep float precision; invalid pixels have weight and value 0, and so has what lies outside.
          const cv::Size size = layers.depth_mm.size();
          cv::Mat value(size, CV_32F), weight(size, CV_32F);
          for_rows(size, [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              const float* z = layers.depth_mm.ptr<float>(row);
              const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
              float *a = value.ptr<float>(row), *b = weight.ptr<float>(row);
              for (int col = 0; col < size.width; ++col) {
                a[col] = reason[col] == 0 ? z[col] - z0 : 0.f;
                b[col] = reason[col] == 0 ? 1.f : 0.f;
              }
            }
          });
          const int width = 2 * static_cast<int>(std::ceil(4 * sigma)) + 1;
          cv::GaussianBlur(value, value, cv::Size(width, width), sigma, sigma, cv::BORDER_CONSTANT);
          cv::GaussianBlur(weight, weight, cv::Size(width, width), sigma, sigma, cv::BORDER_CONSTANT);
          map_depth(layers, [&](int row) {
            return [a = value.ptr<float>(row), b = weight.ptr<float>(row), z0](float, int col) {
              return z0 + a[col] / std::max(b[col], 1e-6f);
            };
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
