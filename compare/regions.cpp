// Which pixels are looked at, from the nominal scene alone.
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "compare/statistic.h"
#include "core/error.h"

namespace binrig {
namespace {

constexpr float interior_edge_px = 4.f;   // edges reach this far into the surfaces (blur, fattening, flying pixels)
constexpr float edge_reach_px = 4.5f;     // pixels this near an edge belong to the edge statistics
constexpr float least_contrast_mm = 8.f;  // the depth step of an edge, EFFECTS.md
const float grazing_cos = std::cos(62.0 * 3.14159265358979 / 180.0);

/// Pixels beside depth edges with the depths on both sides, from an 11 x 11 neighbourhood.
std::vector<CaptureRegions::EdgePixel> edge_pixels(const Channels& channels, const cv::Mat& counted) {
  const cv::Mat& depth = channels.depth_mm;
  cv::Mat far_filled = depth.clone();
  far_filled.setTo(1e9f, depth <= 0);
  cv::Mat fore, back;
  const cv::Mat window = cv::Mat::ones(11, 11, CV_8U);
  cv::erode(far_filled, fore, window);
  cv::dilate(depth, back, window);
  // Which side a pixel is on, from a window so wide that the smoothed gradient below never meets its end.
  cv::Mat fore_wide, back_wide;
  const cv::Mat wide = cv::Mat::ones(21, 21, CV_8U);
  cv::erode(far_filled, fore_wide, wide);
  cv::dilate(depth, back_wide, wide);
  cv::Mat behind(depth.size(), CV_32F);
  for (int v = 0; v < depth.rows; ++v)
    for (int u = 0; u < depth.cols; ++u) {
      const float z = depth.at<float>(v, u);
      behind.at<float>(v, u) = z > 0.5f * (fore_wide.at<float>(v, u) + back_wide.at<float>(v, u)) || z <= 0;
    }
  cv::Mat soft, gx, gy;
  cv::boxFilter(behind, soft, CV_32F, {5, 5});
  cv::Sobel(soft, gx, CV_32F, 1, 0, 5);
  cv::Sobel(soft, gy, CV_32F, 0, 1, 5);
  std::vector<CaptureRegions::EdgePixel> result;
  for (int v = 0; v < depth.rows; ++v)
    for (int u = 0; u < depth.cols; ++u) {
      const float distance = channels.edge_px.at<float>(v, u);
      if (distance > edge_reach_px || counted.at<float>(v, u) == 0.f) continue;
      const float f = fore.at<float>(v, u), b = back.at<float>(v, u);
      if (b - f < least_contrast_mm || b > 1e8f) continue;
      const float x = gx.at<float>(v, u), y = gy.at<float>(v, u);
      if (x == 0 && y == 0) continue;
      const int orientation = std::abs(x) >= std::abs(y) ? (x > 0 ? 0 : 2) : (y > 0 ? 1 : 3);
      const float signed_px = behind.at<float>(v, u) > 0 ? distance : -distance;
      const int bin = std::clamp(static_cast<int>(std::floor(signed_px)) + edge_bins / 2, 0, edge_bins - 1);
      result.push_back({v * depth.cols + u, orientation * edge_bins + bin, f, b});
    }
  return result;
}

}  // namespace

CaptureRegions::CaptureRegions(const Channels& channels, const StatisticContext& context) {
  const cv::Size size = channels.depth_mm.size();
  if (channels.cos_incidence.size() != size || channels.edge_px.size() != size)
    throw Error("Statistics need the perfect depth, incidence and edge distance of every frame");
  if (!context.valid_region.empty() && context.valid_region.size() != size)
    throw Error("The set's valid region has another size than its frames");
  counted = cv::Mat::zeros(size, CV_32F);
  interior = cv::Mat::zeros(size, CV_32F);
  const bool lit_known = channels.projector_gap_mm.size() == size;
  for (int v = 0; v < size.height; ++v)
    for (int u = 0; u < size.width; ++u) {
      if (channels.depth_mm.at<float>(v, u) <= 0) continue;
      if (!context.valid_region.empty() && context.valid_region.at<std::uint8_t>(v, u) == 0) continue;
      counted.at<float>(v, u) = 1.f;
      const bool lit = !lit_known || channels.projector_gap_mm.at<float>(v, u) <= shadow_epsilon_mm;
      if (lit && channels.edge_px.at<float>(v, u) > interior_edge_px &&
          channels.cos_incidence.at<float>(v, u) > grazing_cos)
        interior.at<float>(v, u) = 1.f;
    }
  edges = edge_pixels(channels, counted);
}

}  // namespace binrig
