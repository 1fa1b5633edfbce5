// Bilateral blur: the sensor's own smoothing, which spares depth edges.
//
//   z(p) = sum_q w z(q) / sum_q w over valid q in a square window of the given diameter
//   w = exp(-|p-q|^2 / (2 sigma_px^2)) g((z(q)-z(p))^2 / (2 sigma_z^2))
//   g(x) = (1 - y + y^2/2)^16 for exp(-x), y = x/16 < 1; 0 beyond
//
// g differs from exp(-x) by at most 0.0011 and needs no exponential per pixel. Invalid pixels have no weight: OpenCV's
// filter would mix their zeros into their neighbours. Neighbours whose spatial weight is below 1e-5 are left out: each
// would move a depth by less than 1e-5 of what they differ by.
#include <algorithm>

#include <opencv2/core.hpp>

#include "core/wide.h"
#include "sim/effect.h"

namespace binrig::effects {
namespace {

constexpr double least_weight = 1e-5;

/// So far from every depth that its weight is zero; its square is finite.
constexpr float nowhere_mm = 1e9f;

/// Sums over a row of pixels: deviations of their neighbours times weights, and weights. Deviations from the centre
/// keep float precision at any distance.
struct Sums {
  std::vector<float> steps, weights;
};

/// Weights of the pairs (a[i], b[i]), which are the same for both pixels of a pair, added to the sums of both. The
/// memory of the four sums must not overlap.
BINRIG_WIDE void add_pairs(const float* a, const float* b, float spatial, float inverse, int count,
                           float* __restrict steps_a, float* __restrict weights_a, float* __restrict steps_b,
                           float* __restrict weights_b) {
  for (int i = 0; i < count; ++i) {
    const float step = b[i] - a[i];
    const float y = step * step * inverse;
    float g = y < 1.f ? 1.f - y + 0.5f * (y * y) : 0.f;
    g *= g;
    g *= g;
    g *= g;
    g *= g;
    g *= spatial;
    const float weighted = g * step;
    steps_a[i] += weighted;
    weights_a[i] += g;
    steps_b[i] -= weighted;
    weights_b[i] += g;
  }
}

class BilateralBlur : public Run {
 public:
  explicit BilateralBlur(const EffectInstance& instance) {
    const double sigma_px = instance.value("sigma_px"), sigma_z = instance.value("sigma_z");
    inverse_ = static_cast<float>(1.0 / (32.0 * sigma_z * sigma_z));
    const int widest = static_cast<int>(instance.value("diameter")) / 2;
    for (int j = 0; j <= widest; ++j)
      for (int i = j == 0 ? 1 : -widest; i <= widest; ++i) {
        const double spatial = std::exp(-(i * i + j * j) / (2.0 * sigma_px * sigma_px));
        if (spatial < least_weight) continue;
        half_window_.push_back({j, i, static_cast<float>(spatial)});
        radius_ = std::max({radius_, j, std::abs(i)});
      }
  }

  void apply(Layers& layers, const Channels&, const FrameInstant&) override {
    const cv::Size size = layers.depth_mm.size();
    if (padded_.empty())
      padded_ = cv::Mat(size.height + 2 * radius_, size.width + 2 * radius_, CV_32F, cv::Scalar(nowhere_mm));
    for_rows(size, [&](int first, int last) {
      for (int row = first; row < last; ++row) {
        const float* z = layers.depth_mm.ptr<float>(row);
        const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
        float* to = padded_.ptr<float>(row + radius_) + radius_;
        for (int col = 0; col < size.width; ++col) to[col] = reason[col] == 0 ? z[col] : nowhere_mm;
      }
    });
    for_rows(size, [&](int first, int last) { filter(layers, first, last); });
  }

 private:
  /// A neighbour below, or to the right in the same row; the others are pairs seen from their other end.
  struct Neighbour {
    int rows, cols;
    float spatial;
  };

  /// Rows first .. last-1 of the image. A pixel's sums come in the same order wherever the blocks of rows end.
  void filter(Layers& layers, int first, int last) const {
    const int width = padded_.cols, window = radius_ + 1;
    // Of a row as the upper end of pairs, and as the lower one; for the row at work and those that it reaches down to.
    std::vector<Sums> upper(window), lower(window);
    for (auto* sums : {&upper, &lower})
      for (Sums& s : *sums) s.steps.assign(width, 0.f), s.weights.assign(width, 0.f);
    for (int row = first; row < last + radius_; ++row) {  // of the padded image, `radius_` rows above the image's
      const float* a = padded_.ptr<float>(row);
      Sums& own = upper[row % window];
      for (const auto& [down, right, spatial] : half_window_) {
        const float* b = padded_.ptr<float>(row + down);
        Sums& other = lower[(row + down) % window];
        const int from = std::max(0, -right), to = from + right;
        add_pairs(a + from, b + to, spatial, inverse_, width - std::abs(right), &own.steps[from], &own.weights[from],
                  &other.steps[to], &other.weights[to]);
      }
      Sums& above = lower[row % window];
      if (row >= first + radius_) {
        float* z = layers.depth_mm.ptr<float>(row - radius_);
        const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row - radius_);
        for (int col = 0; col < layers.depth_mm.cols; ++col) {
          const int i = col + radius_;
          const float mean = a[i] + (own.steps[i] + above.steps[i]) / (1.f + (own.weights[i] + above.weights[i]));
          z[col] = reason[col] == 0 ? mean : z[col];
        }
      }
      for (Sums* sums : {&own, &above}) {
        std::fill(sums->steps.begin(), sums->steps.end(), 0.f);
        std::fill(sums->weights.begin(), sums->weights.end(), 0.f);
      }
    }
  }

  int radius_ = 0;
  float inverse_ = 0;  ///< 1 / (32 sigma_z^2)
  std::vector<Neighbour> half_window_;
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
       .deviation = "skips invalid pixels; leaves out spatial weights below 1e-5; range weight (1 - y + y^2/2)^16, y = x/16 < 1, for exp(-x)",
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
