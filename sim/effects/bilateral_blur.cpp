// Bilateral blur: the sensor's own smoothing, which spares depth edges.
//
//   z(p) = sum_q w z(q) / sum_q w over valid q in a square window of the given diameter
//   w = exp(-|p-q|^2 / (2 sigma_px^2)) g((z(q)-z(p))^2 / (2 sigma_z^2)),   g(x) = max(0, 1 - x/16)^16 for exp(-x)
//
// g differs from exp(-x) by at most 0.018 and needs no exponential per pixel. Invalid pixels have no weight: OpenCV's
// filter would mix their zeros into their neighbours.
#include <algorithm>

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

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
// Eight pixels at a time where the machine can. No fused multiply-add: the bytes are the same on every machine.
#define BINRIG_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define BINRIG_WIDE
#endif

/// One row of a window `Width` pixels wide (0: known only at run time), summed over its rows. Deviations from the
/// centre are summed, which keeps float precision at any distance.
template <int Width>
[[gnu::always_inline]] inline void filter_row_of(const Kernel& kernel, const cv::Mat& padded, int row, int cols,
                                                 float* sum, float* weight) {
  const int width = Width > 0 ? Width : 2 * kernel.radius + 1;
  const float* centre = padded.ptr<float>(row + kernel.radius) + kernel.radius;
  const float inverse = kernel.inverse;
  for (int j = 0; j < width; ++j) {
    const float* z = padded.ptr<float>(row + j);
    const float* spatial = kernel.spatial.data() + j * width;
    for (int col = 0; col < cols; ++col) {
      const float here = centre[col];
      float total = 0.f, steps = 0.f;
      for (int i = 0; i < width; ++i) {
        const float step = z[col + i] - here;
        float g = 1.f - step * step * inverse;
        g = g > 0.f ? g : 0.f;
        g *= g;
        g *= g;
        g *= g;
        g *= g;
        g *= spatial[i];
        total += g;
        steps += g * step;
      }
      weight[col] += total;
      sum[col] += steps;
    }
  }
}

BINRIG_WIDE void filter_row(const Kernel& kernel, const cv::Mat& padded, int row, int cols, float* sum, float* weight,
                            float* out) {
  std::fill(sum, sum + cols, 0.f);
  std::fill(weight, weight + cols, 0.f);
  switch (kernel.radius) {
    case 1:
      filter_row_of<3>(kernel, padded, row, cols, sum, weight);
      break;
    case 2:
      filter_row_of<5>(kernel, padded, row, cols, sum, weight);
      break;
    case 3:
      filter_row_of<7>(kernel, padded, row, cols, sum, weight);
      break;
    case 4:
      filter_row_of<9>(kernel, padded, row, cols, sum, weight);
      break;
    default:
      filter_row_of<0>(kernel, padded, row, cols, sum, weight);
  }
  const float* centre = padded.ptr<float>(row + kernel.radius) + kernel.radius;
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
