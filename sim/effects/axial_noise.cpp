// Axial noise: the same disparity noise is more depth noise further away.
//
//   sigma' = sigma (z / z0)^exponent
//
// z is the perfect depth. Exponent 2 is the stereo law sigma_z = z^2 sigma_d / (f B); 0 is no dependence.
#include <opencv2/core.hpp>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& axial_noise() {
  static const Effect effect{
      {.name = "axial_noise",
       .phenomenon = "Noise grows with the distance.",
       .stage = Stage::amplitude,
       .formula = "sigma' = sigma (z / z0)^exponent",
       .citation =
           "Khoshelham and Elberink, Accuracy and resolution of Kinect depth data, Sensors 12 (2012): exponent 2",
       .deviation = "the exponent is free",
       .parameters = {{.name = "exponent",
                       .unit = "1",
                       .lower = -2,
                       .upper = 8,
                       .typical_low = 1,
                       .typical_high = 4,
                       .neutral = 0.0,
                       .initial = 2,
                       .meaning = "power of the distance"}},
       .neighbourhood_px = 0,
       .amplitude = "exponent",
       .revealed_by = "repeated frames of planes at three distances"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double exponent = instance.value("exponent"), z0 = context.reference_distance_mm;
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          for_rows(layers.depth_mm.size(), [&](int first, int last) {
            cv::Mat factor;
            for (int row = first; row < last; ++row) {
              cv::max(channels.depth_mm.row(row), 1.0, factor);
              cv::pow(factor * (1 / z0), exponent, factor);
              const float* f = factor.ptr<float>();
              float* scale = layers.sigma_scale.ptr<float>(row);
              for (int col = 0; col < layers.depth_mm.cols; ++col) scale[col] *= f[col];
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
