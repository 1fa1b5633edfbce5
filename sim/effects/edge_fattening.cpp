// Edge fattening: a matching window that reaches over an edge takes the foreground's disparity, so that things grow by
// about half a window.
//
//   z' = least valid depth within half_window, where e < half_window + 1.5;   e = distance to the nearest depth edge
#include "sim/effect.h"

namespace binrig::effects {

const Effect& edge_fattening() {
  static const Effect effect{
      {.name = "edge_fattening",
       .phenomenon = "Foreground things look larger than they are.",
       .stage = Stage::matching,
       .formula = "z' = least valid depth within half_window, where e < half_window + 1.5",
       .citation = "known of every window-based matcher: Hirschmueller, Innocent and Garibaldi, Real-time "
                   "correlation-based stereo vision with reduced border errors, IJCV 47 (2002)",
       .deviation = "a sharp minimum; a real window changes over where the stronger texture wins",
       .parameters = {{.name = "half_window",
                       .unit = "px",
                       .lower = 0,
                       .upper = 12,
                       .typical_low = 1,
                       .typical_high = 4,
                       .neutral = 0.0,
                       .initial = 2,
                       .kind = ParameterKind::integer,
                       .interpolate = false,
                       .meaning = "half the side of the matching window"}},
       .reads = Channel::depth | Channel::edge_distance,
       .neighbourhood_px = 12,
       .amplitude = "half_window",
       .revealed_by = "a step or a box on a plane"},
      [](const EffectInstance& instance, const CaptureContext&) {
        const int half = static_cast<int>(instance.value("half_window"));
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant&) {
          if (half == 0) return;
          const cv::Mat depth = layers.depth_mm.clone();
          for_rows(depth.size(), [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              const float* e = channels.edge_px.ptr<float>(row);
              for (int col = 0; col < depth.cols; ++col) {
                if (!(e[col] < half + 1.5f) || !layers.valid(row, col)) continue;
                layers.depth_mm.at<float>(row, col) = valid_range(depth, layers.reason, row, col, half).first;
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
