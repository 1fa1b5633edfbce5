// Temporal filter: the sensor averages over frames, which makes it calm and slow.
//
//   y_t = weight z_t + (1 - weight) y_(t-1);   the first frame as it is
//
// Where one of the two is invalid the other stands; whether a pixel is valid is the present frame's business.
#include "sim/effect.h"

namespace binrig::effects {
namespace {

class TemporalFilter : public Run {
 public:
  explicit TemporalFilter(float weight) : weight_(weight) {}

  void apply(Layers& layers, const Channels&, const FrameInstant&) override {
    const cv::Size size = layers.depth_mm.size();
    if (before_.empty()) before_ = cv::Mat::zeros(size, CV_32F);  // 0 = never measured yet
    for_rows(size, [&](int first, int last) {
      for (int row = first; row < last; ++row) {
        float *z = layers.depth_mm.ptr<float>(row), *y = before_.ptr<float>(row);
        const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
        for (int col = 0; col < size.width; ++col) {
          const float mixed = y[col] == 0.f ? z[col] : y[col] + weight_ * (z[col] - y[col]);
          y[col] = reason[col] == 0 ? mixed : y[col];
          z[col] = y[col];
        }
      }
    });
  }

 private:
  float weight_;
  cv::Mat before_;
};

}  // namespace

const Effect& temporal_filter() {
  static const Effect effect{
      {.name = "temporal_filter",
       .phenomenon = "Frames are averaged with those before them: less noise, and trails.",
       .stage = Stage::temporal,
       .formula = "y_t = weight z_t + (1 - weight) y_(t-1)",
       .citation = "plain exponential smoothing; the temporal filter of drivers such as librealsense has the same form",
       .deviation = "no threshold on the step and no persistence rules",
       .parameters = {{.name = "weight",
                       .unit = "1",
                       .lower = 0.01,
                       .upper = 1,
                       .typical_low = 0.2,
                       .typical_high = 0.95,
                       .neutral = 1.0,
                       .initial = 0.6,
                       .meaning = "weight of the present frame; lower is stronger"}},
       .neighbourhood_px = 0,
       .amplitude = "weight",
       .stronger_is_larger = false,
       .needs = {.repeats = true},
       .revealed_by = "repeated frames of a plane; a moving target"},
      [](const EffectInstance& instance, const CaptureContext&) -> std::unique_ptr<Run> {
        return std::make_unique<TemporalFilter>(static_cast<float>(instance.value("weight")));
      }};
  return effect;
}

}  // namespace binrig::effects
