// Flying pixels: a pixel that sees both sides of an edge mixes them into a depth at which there is nothing.
//
//   where e <= width, with the given probability: z' uniform between the least and the largest valid depth of the 7 x 7
//   pixels around; e = distance to the nearest depth edge
#include "sim/effect.h"

namespace binrig::effects {

const Effect& flying_pixels() {
  static const Effect effect{
      {.name = "flying_pixels",
       .phenomenon = "Depths hang in the air between a thing and what is behind it.",
       .stage = Stage::matching,
       .formula =
           "where e <= width, with the given probability, z' uniform between the local least and largest depth (7 x 7)",
       .citation = "known of every depth camera: a pixel at a rim receives a mix of object and background "
                   "(pmdtechnologies, FAQ: flying pixel)",
       .deviation = "",
       .parameters = {{.name = "probability",
                       .unit = "1",
                       .lower = 0,
                       .upper = 1,
                       .typical_low = 0.1,
                       .typical_high = 0.9,
                       .neutral = 0.0,
                       .initial = 0.4,
                       .meaning = "share of the pixels near edges that fly"},
                      {.name = "width",
                       .unit = "px",
                       .lower = 0.5,
                       .upper = 20,
                       .typical_low = 1,
                       .typical_high = 3,
                       .initial = 1.5,
                       .meaning = "distance from the edge up to which pixels may fly"}},
       .reads = Channel::depth | Channel::edge_distance,
       .neighbourhood_px = 3,
       .amplitude = "probability",
       .revealed_by = "a step or a box on a plane, repeated frames"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const double probability = instance.value("probability");
        const float width = static_cast<float>(instance.value("width"));
        const CaptureContext* capture = &context;
        return stateless([=](Layers& layers, const Channels& channels, const FrameInstant& instant) {
          const RandomStream draws = capture->draws(instant.number), places = draws.child("places");
          const cv::Mat depth = layers.depth_mm.clone();
          for_rows(depth.size(), [&](int first, int last) {
            for (int row = first; row < last; ++row) {
              const float* e = channels.edge_px.ptr<float>(row);
              for (int col = 0; col < depth.cols; ++col) {
                if (!(e[col] <= width) || !layers.valid(row, col)) continue;
                const std::uint64_t pixel = static_cast<std::uint64_t>(row) * depth.cols + col;
                if (draws.uniform(pixel) >= probability) continue;
                const auto [low, high] = valid_range(depth, layers.reason, row, col, 3);
                layers.depth_mm.at<float>(row, col) = low + (high - low) * static_cast<float>(places.uniform(pixel));
              }
            }
          });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
