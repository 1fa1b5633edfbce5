// Low confidence: on surfaces seen at grazing incidence the pattern is squeezed until the matcher rejects it.
//
//   invalid (low_confidence) where theta > threshold + disturbance * field(u, v, frame)
//
// theta: angle between viewing ray and surface normal. The test runs on cosines: cos(t + s) is expanded in the small
// disturbance s, which saves an acos per pixel.
#include <numbers>

#include "sim/effect.h"

namespace binrig::effects {
namespace {

constexpr float pi = std::numbers::pi_v<float>;
constexpr double rad_per_deg = std::numbers::pi / 180;

class LowConfidence : public Run {
 public:
  LowConfidence(const EffectInstance& instance, const CaptureContext& context)
      : context_(context),
        field_(disturbance_field(instance, context)),
        cosine_(static_cast<float>(std::cos(instance.value("threshold") * rad_per_deg))),
        sine_(static_cast<float>(std::sin(instance.value("threshold") * rad_per_deg))),
        disturbance_rad_(static_cast<float>(instance.value("disturbance") * rad_per_deg)) {}

  void apply(Layers& layers, const Channels& channels, const FrameInstant& instant) override {
    const float furthest = static_cast<float>(disturbance_rad_ * field_.bound());
    if (const float t = std::acos(cosine_);
        !any_between(layers, channels.cos_incidence, std::cos(std::min(t + furthest, pi)),
                     std::cos(std::max(t - furthest, 0.f)))) {  // no surface so near to the threshold
      invalidate_where(layers, Reason::low_confidence, [&](int row) {
        return
            [cos_theta = channels.cos_incidence.ptr<float>(row), c = cosine_](int col) { return cos_theta[col] < c; };
      });
      return;
    }
    const cv::Mat& field = field_.at(context_.draws(instant.number));
    invalidate_where(layers, Reason::low_confidence, [&](int row) {
      const float* cos_theta = channels.cos_incidence.ptr<float>(row);
      const float* n = field.ptr<float>(row);
      return [cos_theta, n, c = cosine_, s = sine_, d = disturbance_rad_](int col) {
        // Taylor to the fifth order: at 4 sigma of the largest disturbance (0.56 rad) the error is 5e-5.
        const float a = d * n[col], a2 = a * a;
        const float cos_a = 1.f - a2 * (0.5f - a2 * (1.f / 24.f)), sin_a = a * (1.f - a2 * (1.f / 6.f - a2 / 120.f));
        return cos_theta[col] < c * cos_a - s * sin_a;
      };
    });
  }

 private:
  const CaptureContext& context_;
  DisturbanceField field_;
  float cosine_, sine_, disturbance_rad_;
};

}  // namespace

const Effect& low_confidence() {
  static const Effect effect{
      {.name = "low_confidence",
       .phenomenon = "Surfaces seen at grazing incidence give no depth.",
       .stage = Stage::signal_mask,
       .formula = "invalid where theta > threshold + disturbance * field; theta = angle from viewing ray to normal",
       .citation = "thesis 5.3.7",
       .deviation = "",
       .parameters = {{.name = "threshold",
                       .unit = "deg",
                       .lower = 10,
                       .upper = 130,
                       .typical_low = 60,
                       .typical_high = 80,
                       .neutral = 130,
                       .initial = 75,
                       .meaning = "largest angle of incidence that gives depth"},
                      {.name = "disturbance",
                       .unit = "deg",
                       .lower = 0,
                       .upper = 8,
                       .typical_low = 0.2,
                       .typical_high = 4,
                       .initial = 1,
                       .meaning = "standard deviation of the threshold over the image"},
                      disturbance_grid(),
                      disturbance_share()},
       .options = {disturbance_weight()},
       .reads = Channel::depth | Channel::cos_incidence,
       .neighbourhood_px = 0,
       .reason = Reason::low_confidence,
       .amplitude = "threshold",
       .stronger_is_larger = false,
       .revealed_by = "a sphere or a cylinder, or a plane tilted by 60 to 80 degrees"},
      [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
        return std::make_unique<LowConfidence>(instance, context);
      }};
  return effect;
}

}  // namespace binrig::effects
