// Specular saturation: highlights of the projector drive the infra-red pixels into their full well; no dots are left.
//
//   invalid (saturated) where specular > threshold + disturbance * field(u, v, frame)
//
// field: coherent noise of unit standard deviation (core/coherent_noise.h), part of it fixed through the capture.
#include "sim/effect.h"

namespace binrig::effects {
namespace {

class Saturation : public Run {
 public:
  Saturation(const EffectInstance& instance, const CaptureContext& context)
      : context_(context),
        field_(disturbance_field(instance, context)),
        threshold_(static_cast<float>(instance.value("threshold"))),
        disturbance_(static_cast<float>(instance.value("disturbance"))) {}

  void apply(Layers& layers, const Channels& channels, const FrameInstant& instant) override {
    const float furthest = static_cast<float>(disturbance_ * field_.bound());
    if (!any_between(layers, channels.specular, threshold_ - furthest, threshold_ + furthest)) {
      invalidate_where(layers, Reason::saturated, [&](int row) {  // no highlight so near to the threshold
        return [specular = channels.specular.ptr<float>(row), t = threshold_](int col) { return specular[col] > t; };
      });
      return;
    }
    const cv::Mat& field = field_.at(context_.draws(instant.number));
    invalidate_where(layers, Reason::saturated, [&](int row) {
      const float* specular = channels.specular.ptr<float>(row);
      const float* n = field.ptr<float>(row);
      return [specular, n, t = threshold_, d = disturbance_](int col) { return specular[col] > t + d * n[col]; };
    });
  }

 private:
  const CaptureContext& context_;
  DisturbanceField field_;
  float threshold_, disturbance_;
};

}  // namespace

const Effect& specular_saturation() {
  static const Effect effect{
      {.name = "specular_saturation",
       .phenomenon = "Highlights saturate the infra-red image, so that shiny surfaces have holes.",
       .stage = Stage::signal_mask,
       .formula = "invalid where specular > threshold + disturbance * field; specular = ks max(0, R.V)^n",
       .citation = "thesis 5.3.7; highlight after Phong, Illumination for computer generated pictures, CACM 1975",
       .deviation = "",
       .parameters = {{.name = "threshold",
                       .unit = "1",
                       .lower = 0.01,
                       .upper = 5,
                       .typical_low = 0.3,
                       .typical_high = 0.9,
                       .neutral = 5,
                       .initial = 0.6,
                       .meaning = "specular intensity at which the pixel saturates"},
                      {.name = "disturbance",
                       .unit = "1",
                       .lower = 0,
                       .upper = 0.5,
                       .typical_low = 0.01,
                       .typical_high = 0.2,
                       .initial = 0.05,
                       .meaning = "standard deviation of the threshold over the image"},
                      disturbance_grid(),
                      disturbance_share()},
       .options = {disturbance_weight()},
       .reads = Channel::depth | Channel::specular,
       .neighbourhood_px = 0,
       .reason = Reason::saturated,
       .amplitude = "threshold",
       .stronger_is_larger = false,
       .needs = {.ir = true},
       .revealed_by = "a shiny curved part, or a polished plane facing half-way between camera and projector"},
      [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
        return std::make_unique<Saturation>(instance, context);
      }};
  return effect;
}

}  // namespace binrig::effects
