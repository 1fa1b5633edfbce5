#include "core/smooth_noise.h"

#include <bit>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "core/recent_fields.h"

namespace binrig {
namespace {

/// Half a filter's width: drawn with a margin, since a filter that stops at the border would make the map stronger there.
int margin_of(double length) { return static_cast<int>(std::ceil(3 * length)) + 1; }

cv::Mat kernel_of(double length) { return cv::getGaussianKernel(2 * margin_of(length) - 1, length, CV_32F); }

void draw_map(cv::Size size, double length, const RandomStream& draws, cv::Mat& map) {
  const int margin = margin_of(length);
  cv::Mat wide(size.height + 2 * margin, size.width + 2 * margin, CV_32F);
  draws.fill_normal(wide);
  if (length > 0) cv::sepFilter2D(wide, wide, CV_32F, kernel_of(length), kernel_of(length));
  map = wide(cv::Rect({margin, margin}, size)).clone();
}

/// With which the map's expected variance is 1, whatever one draw's is.
double gain_of(double length) {
  if (length <= 0) return 1;
  const cv::Mat kernel = kernel_of(length);
  return 1 / kernel.dot(kernel);
}

}  // namespace

cv::Mat smooth_noise(cv::Size size, double length_px, double amplitude, const RandomStream& draws) {
  const std::uint64_t kind = mix_keys(mix_keys(hash_text("smooth noise"), std::bit_cast<std::uint64_t>(length_px)),
                                      mix_keys(size.height, size.width));
  const cv::Mat map = recent_field(kind, draws, [&](cv::Mat& field) { draw_map(size, length_px, draws, field); });
  return map * (amplitude * gain_of(length_px));
}

}  // namespace binrig
