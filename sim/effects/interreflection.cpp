// Interreflection: in concave creases each wall lights the other, and the second image of the pattern pulls depth off.
//
//   z' = z + amplitude exp(-c / length),   c = distance (px) to the nearest concave crease
#include <opencv2/core.hpp>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& interreflection() {
  static const Effect effect{
      {.name = "interreflection",
       .phenomenon = "Depth is wrong beside concave creases, where walls light each other.",
       .stage = Stage::geometry,
       .formula = "z' = z + amplitude exp(-c / length), c = distance to the nearest concave crease",
       .citation =
           "plain exponential fall-off from the crease; multi-path light as in Fuentes-Jimenez, Pizarro, Mazo and "
           "Palazuelos, Modelling and correction of multipath interference in time of flight cameras, CVPR 2012",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = -20,
                       .upper = 20,
                       .typical_low = 0.2,
                       .typical_high = 2,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.5,
                       .meaning = "error at the crease; positive = a groove looks deeper"},
                      {.name = "length",
                       .unit = "px",
                       .lower = 0.5,
                       .upper = 200,
                       .typical_low = 3,
                       .typical_high = 25,
                       .initial = 8,
                       .log_scaled = true,
                       .meaning = "distance over which the error falls to 1/e"}},
       .reads = Channel::depth | Channel::crease_distance,
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .revealed_by = "a V-groove, or a box standing on a plane"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float a = static_cast<float>(instance.value("amplitude")),
                    inverse = static_cast<float>(-1 / instance.value("length"));
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          for_rows(layers.depth_mm.size(), [&](int first, int last) {
            cv::Mat fall;
            for (int row = first; row < last; ++row) {
              cv::exp(channels.crease_px.row(row) * inverse, fall);
              const float* f = fall.ptr<float>();
              // The channel is clipped at 64 px: there is no crease within reach.
              const float* c = channels.crease_px.ptr<float>(row);
              const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
              float* z = layers.depth_mm.ptr<float>(row);
              for (int col = 0; col < layers.depth_mm.cols; ++col) {
                const float mapped = z[col] + (c[col] < 63.9f ? a * f[col] : 0.f);
                z[col] = reason[col] == 0 ? mapped : z[col];
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
