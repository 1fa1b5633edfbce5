// Fixed pattern noise: every unit carries its own bumpy error map, the same in each capture (spread of the pattern's
// dots, of the reference image, of the pixels).
//
//   z' = z + m(u, v),   m = Gaussian noise through a Gaussian of sigma = correlation_length, scaled to amplitude
//
// The map belongs to the unit (unit_seed), not to the seed of a recording.
#include <cmath>
#include <string>
#include <tuple>

#include <opencv2/imgproc.hpp>

#include "core/recently_made.h"
#include "sim/effect.h"

namespace binrig::effects {

namespace {

constexpr std::size_t kept_bytes = 96 << 20;  // 78 maps of 640 x 480

struct Drawn {
  cv::Mat map;
  double gain = 1;  ///< with which the map's expected variance is 1, whatever this draw's is
};

Drawn draw_map(const CaptureContext& context, double length) {
  // Drawn with a margin: a filter that stops at the border would make the map stronger there.
  const int margin = static_cast<int>(std::ceil(3 * length)) + 1;
  cv::Mat wide(context.camera.height + 2 * margin, context.camera.width + 2 * margin, CV_32F);
  context.unit_draws().fill_normal(wide);
  Drawn unit;
  if (length > 0) {
    const cv::Mat kernel = cv::getGaussianKernel(2 * margin - 1, length, CV_32F);
    cv::sepFilter2D(wide, wide, CV_32F, kernel, kernel);
    unit.gain = 1 / kernel.dot(kernel);
  }
  unit.map = wide(cv::Rect(margin, margin, context.camera.width, context.camera.height)).clone();
  return unit;
}

/// It costs more than all else in a frame, and each capture of a unit has the same one.
Drawn shared_map(const CaptureContext& context, double length) {
  using Key = std::tuple<std::uint64_t, std::string, int, int, double>;
  static RecentlyMade<Key, Drawn> recent(kept_bytes,
                                         [](const Drawn& unit) { return unit.map.total() * unit.map.elemSize(); });
  return recent.get({context.unit_seed, context.instance, context.camera.height, context.camera.width, length},
                    [&] { return draw_map(context, length); });
}

}  // namespace

const Effect& fixed_pattern_noise() {
  static const Effect effect{
      {.name = "fixed_pattern_noise",
       .phenomenon = "Every unit carries its own fixed map of small depth errors.",
       .stage = Stage::geometry,
       .formula =
           "z' = z + m(u, v); m = white noise through a Gaussian of sigma correlation_length, scaled to amplitude",
       .citation = "plain stationary Gaussian field; fixed-pattern noise as in EMVA Standard 1288 (spatial "
                   "non-uniformity), of depth instead of grey values",
       .deviation = "",
       .parameters = {{.name = "amplitude",
                       .unit = "mm",
                       .lower = 0,
                       .upper = 20,
                       .typical_low = 0.02,
                       .typical_high = 0.5,
                       .neutral = 0.0,
                       .initial = 0.1,
                       .meaning = "standard deviation of the map"},
                      {.name = "correlation_length",
                       .unit = "px",
                       .lower = 0,
                       .upper = 100,
                       .typical_low = 2,
                       .typical_high = 30,
                       .initial = 6,
                       .meaning = "sigma of the Gaussian that smooths the map"}},
       .neighbourhood_px = 0,
       .amplitude = "amplitude",
       .per_unit_map = true,
       .revealed_by = "repeated frames of planes at several places: what is common to all of them"},
      [](const EffectInstance& instance, const CaptureContext& context) {
        const Drawn unit = shared_map(context, instance.value("correlation_length"));
        const cv::Mat map = unit.map * (instance.value("amplitude") * unit.gain);
        return stateless([=](Layers& layers, const Channels&, const FrameInstant&) {
          map_depth(layers,
                    [&](int row) { return [m = map.ptr<float>(row)](float z, int col) { return z + m[col]; }; });
        });
      }};
  return effect;
}

}  // namespace binrig::effects
