// Disparity offset: the reference image or the rectification is shifted along the baseline, so that every disparity is
// off by the same part of a pixel and depth by about -z^2 offset / (f B).
//
//   z' = f B / (d + offset),   d = f B / z
#include "sim/effect.h"

namespace binrig::effects {

const Effect& disparity_offset() {
  static const Effect effect{
      {.name = "disparity_offset",
       .phenomenon = "Disparities are off by a constant, which bends depth with the square of the distance.",
       .stage = Stage::geometry,
       .formula = "z' = f B / (d + offset), d = f B / z",
       .citation = "Khoshelham and Elberink, Accuracy and resolution of Kinect depth data, Sensors 12 (2012): "
                   "normalised disparity has an offset",
       .deviation = "",
       .parameters = {{.name = "offset",
                       .unit = "px",
                       .lower = -10,
                       .upper = 10,
                       .typical_low = 0.02,
                       .typical_high = 0.6,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "disparity added everywhere; a positive one brings things nearer"}},
       .neighbourhood_px = 0,
       .amplitude = "offset",
       .needs = {.baseline = true},
       .revealed_by = "planes at three distances or more, or a wide range of depths in one view"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const float offset = static_cast<float>(instance.value("offset")),
                    fb = static_cast<float>(context.focal_baseline());
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers,
                    [&](int) { return [offset, fb](float z, int) { return with_disparity_added(z, offset, fb); }; });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
