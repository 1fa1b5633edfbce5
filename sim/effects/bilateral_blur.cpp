// Bilateral blur: the sensor's own smoothing, which spares depth edges.
//
//   z(p) = sum_q w z(q) / sum_q w over valid q in a square window of the given diameter
//   w = exp(-|p-q|^2 / (2 sigma_px^2)) g((z(q)-z(p))^2 / (2 sigma_z^2)),   g(x) = max(0, 1 - x/16)^16 for exp(-x)
//
// g differs from exp(-x) by at most 0.018 and needs no exponential per pixel. Invalid pixels have no weight: OpenCV's
// filter would mix their zeros into their neighbours.
#include <opencv2/core.hpp>

#include "sim/effect.h"

namespace binrig::effects {
namespace {

/// So far from every depth that its weight is zero; its square is finite.
constexpr float nowhere_mm = 1e9f;

struct Kernel {
  int radius;
  std::vector<float> spatial;  ///< (2 radius + 1)^2, row-wise
  float inverse;               ///< 1 / (32 sigma_z^2)
};

void filter_row(const Kernel& kernel, const cv::Mat& padded, int row, int cols, float* sum, float* weight, float* out) {
  const int width = 2 * kernel.radius + 1;
  const float* centre = padded.ptr<float>(row + kernel.radius) + kernel.radius;
  // The centre itself has weight 1; deviations from it are summed, which keeps float precision at any distance.
  for (int col = 0; col < cols; ++col) {
    sum[col] = 0.f;
    weight[col] = 1.f;
  }
  for (int j = 0; j < width; ++j) {
    for (int i = 0; i < width; ++i) {
      if (i == kernel.radius && j == kernel.radius) continue;
      const float* z = padded.ptr<float>(row + j) + i;
      const float spatial = kernel.spatial[j * width + i], inverse = kernel.inverse;
      for (int col = 0; col < cols; ++col) {
        const float step = z[col] - centre[col];
        float g = 1.f - step * step * inverse;
        g = g > 0.f ? g : 0.f;
        g *= g;
        g *= g;
        g *= g;
        g *= g;
        g *= spatial;
        weight[col] += g;
        sum[col] += g * step;
      }
    }
  }
  for (int col = 0; col < cols; ++col) out[col] = centre[col] + sum[col] / weight[col];
}

class BilateralBlur : public Run {
 public:
  explicit BilateralBlur(const EffectInstance& instance) {
    const double sigma_px = instance.value("sigma_px"), sigma_z = instance.value("sigma_z");
    kernel_.radius = static_cast<int>(instance.value("diameter")) / 2;
    kernel_.inverse = static_cast<float>(1.0 / (32.0 * sigma_z * sigma_z));
    for (int j = -kernel_.radius; j <= kernel_.radius; ++j) {
      for (int i = -kernel_.radius; i <= kernel_.radius; ++i) {
        kernel_.spatial.push_back(static_cast<float>(std::exp(-(i * i + j * j) / (2.0 * sigma_px * sigma_px))));
      }
    }
  }

  void apply(Layers& layers, const Channels&, const FrameInstant&) override {
    const cv::Size size = layers.depth_mm.size();
    const int radius = kernel_.radius;
    if (padded_.empty()) {
      padded_ = cv::Mat(size.height + 2 * radius, size.width + 2 * radius, CV_32F, cv::Scalar(nowhere_mm));
    }
    for_rows(size, [&](int first, int last) {
      for (int row = first; row < last; ++row) {
        const float* z = layers.depth_mm.ptr<float>(row);
        const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
        float* to = padded_.ptr<float>(row + radius) + radius;
        for (int col = 0; col < size.width; ++col) to[col] = reason[col] == 0 ? z[col] : nowhere_mm;
      }
    });
    for_rows(size, [&](int first, int last) {
      std::vector<float> sum(size.width), weight(size.width), out(size.width);
      for (int row = first; row < last; ++row) {
        filter_row(kernel_, padded_, row, size.width, sum.data(), weight.data(), out.data());
        float* z = layers.depth_mm.ptr<float>(row);
        const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
        for (int col = 0; col < size.width; ++col) z[col] = reason[col] == 0 ? out[col] : z[col];
      }
    });
  }

 private:
  Kernel kernel_;
  cv::Mat padded_;
};

}  // namespace

const Effect& bilateral_blur() {
  static const Effect effect{
      {.name = "bilateral_blur",
       .phenomenon = "The sensor smooths its depth but spares steps.",
       .stage = Stage::spatial,
       .formula = "bilateral filter of the depth over valid pixels",
       .citation = "Tomasi and Manduchi, Bilateral filtering for gray and color images, ICCV 1998; thesis 5.3.5",
       .deviation = "skips invalid pixels; range weight max(0, 1 - x/16)^16 for exp(-x)",
       .parameters = {{.name = "sigma_px",
                       .unit = "px",
                       .lower = 0,
                       .upper = 10,
                       .typical_low = 0.3,
                       .typical_high = 2,
                       .neutral = 0,
                       .initial = 1,
                       .meaning = "how far the smoothing reaches"},
                      {.name = "sigma_z",
                       .unit = "mm",
                       .lower = 0.01,
                       .upper = 1000,
                       .typical_low = 0.5,
                       .typical_high = 20,
                       .initial = 2,
                       .log_scaled = true,
                       .meaning = "depth differences well beyond this stay sharp"},
                      {.name = "diameter",
                       .unit = "px",
                       .lower = 1,
                       .upper = 21,
                       .typical_low = 3,
                       .typical_high = 9,
                       .initial = 5,
                       .kind = ParameterKind::integer,
                       .interpolate = false,
                       .meaning = "side of the window; an even value acts as the next odd one"}},
       .neighbourhood_px = 10,
       .amplitude = "sigma_px",
       .revealed_by = "repeated frames of a plane (spectrum) with a step in view (edges)"},
      [](const EffectInstance& instance, const CaptureContext&) -> std::unique_ptr<Run> {
        return std::make_unique<BilateralBlur>(instance);
      }};
  return effect;
}

}  // namespace binrig::effects
