// Intensity bias: where the pattern comes back stronger or weaker, the edges of dots (or the phase) are found earlier
// or later.
//
//   z' = z + coefficient ln(I / 0.4),   I = infra-red intensity, at least 0.01
#include <opencv2/core.hpp>

#include "sim/effect.h"

namespace binrig::effects {

const Effect& intensity_bias() {
  static const Effect effect{
      {.name = "intensity_bias",
       .phenomenon = "Bright and dark surfaces at the same distance differ in depth.",
       .stage = Stage::geometry,
       .formula = "z' = z + coefficient ln(max(I, 0.01) / 0.4)",
       .citation = "intensity-related error as in Lindner, Schiller, Kolb and Koch, Time-of-flight sensor calibration "
                   "for accurate range sensing, CVIU 114 (2010)",
       .deviation = "logarithmic instead of their spline over range and amplitude",
       .parameters = {{.name = "coefficient",
                       .unit = "mm",
                       .lower = -20,
                       .upper = 20,
                       .typical_low = 0.05,
                       .typical_high = 0.5,
                       .either_sign = true,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "depth added where the intensity is e times 0.4"}},
       .reads = Channel::depth | Channel::ir,
       .neighbourhood_px = 0,
       .amplitude = "coefficient",
       .needs = {.ir = true},
       .revealed_by = "a chart of several albedos on a plane"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const float c = static_cast<float>(instance.value("coefficient"));
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          for_rows(layers.depth_mm.size(), [&](int first, int last) {
            cv::Mat logarithm;
            for (int row = first; row < last; ++row) {
              cv::max(channels.ir.row(row), 0.01, logarithm);
              cv::log(logarithm, logarithm);
              const float* ln = logarithm.ptr<float>();
              const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
              float* z = layers.depth_mm.ptr<float>(row);
              for (int col = 0; col < layers.depth_mm.cols; ++col) {
                const float mapped = z[col] + c * (ln[col] + 0.916290732f);  // -ln 0.4
                z[col] = reason[col] == 0 ? mapped : z[col];
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
