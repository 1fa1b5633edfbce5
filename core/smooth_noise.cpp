#include "core/smooth_noise.h"

#include <cmath>
#include <tuple>

#include <opencv2/imgproc.hpp>

#include "core/recently_made.h"

namespace binrig {
namespace {

constexpr std::size_t kept_bytes = 96 << 20;  // 78 maps of 640 x 480

struct Drawn {
  cv::Mat map;
  double gain = 1;  ///< with which the map's expected variance is 1, whatever this draw's is
};

Drawn draw_map(cv::Size size, double length, const RandomStream& draws) {
  // Drawn with a margin: a filter that stops at the border would make the map stronger there.
  const int margin = static_cast<int>(std::ceil(3 * length)) + 1;
  cv::Mat wide(size.height + 2 * margin, size.width + 2 * margin, CV_32F);
  draws.fill_normal(wide);
  Drawn drawn;
  if (length > 0) {
    const cv::Mat kernel = cv::getGaussianKernel(2 * margin - 1, length, CV_32F);
    cv::sepFilter2D(wide, wide, CV_32F, kernel, kernel);
    drawn.gain = 1 / kernel.dot(kernel);
  }
  drawn.map = wide(cv::Rect({margin, margin}, size)).clone();
  return drawn;
}

}  // namespace

cv::Mat smooth_noise(cv::Size size, double length_px, double amplitude, const RandomStream& draws) {
  using Key = std::tuple<std::uint64_t, int, int, double>;
  static RecentlyMade<Key, Drawn> recent(kept_bytes,
                                         [](const Drawn& drawn) { return drawn.map.total() * drawn.map.elemSize(); });
  const Drawn drawn =
      recent.get({draws.key(), size.height, size.width, length_px}, [&] { return draw_map(size, length_px, draws); });
  return drawn.map * (amplitude * drawn.gain);
}

}  // namespace binrig
