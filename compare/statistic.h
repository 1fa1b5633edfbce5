// The contract of the statistics that measured and simulated frames are compared by.
//
// A segment of the statistics vector is one file in compare/statistics/. It reads a capture frame by frame (memory does
// not grow with their number) and ends in raw values; differences of *stabilised* raw values (a log of a variance, the
// arcsine of a share) are what compare/ and diagnose/ work with. The same code runs on measured and simulated frames.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/channels.h"
#include "core/frame.h"
#include "core/recording_set.h"

namespace binrig {

/// What is known of a capture before its first frame.
struct StatisticContext {
  CaptureInfo capture;
  int frames = 1;  ///< that will come
  Camera camera;
  double depth_scale_mm = 0;  ///< storage step; 0 = unknown
  double focal_baseline = 0;  ///< f * B, px mm; 0 = unknown
  bool motion = false;        ///< poses differ between frames
  cv::Mat valid_region;       ///< CV_8U, outside (0) nothing counts (ForwardModel::region); empty = the whole image

  /// Side of a bin of bias maps (about 80 x 60 bins an image) and of a cell of noise and drop-out maps (40 x 30), px.
  int bin_px() const { return std::max(1, (camera.width + 40) / 80); }
  int cell_px() const { return std::max(2, (camera.width + 20) / 40); }
  int grid_cols(int side_px) const { return (camera.width + side_px - 1) / side_px; }
  int grid_rows(int side_px) const { return (camera.height + side_px - 1) / side_px; }
};

/// Where in the image what is looked at; a function of the perfect channels of the nominal scene alone, so that
/// measured and simulated frames are read at the same pixels. Pixels without a surface in the model, or outside the
/// set's valid region, count nowhere.
struct CaptureRegions {
  CaptureRegions(const Channels& channels, const StatisticContext& context);

  cv::Mat counted;   ///< CV_32F, 1 where a surface is and the set speaks, else 0
  cv::Mat interior;  ///< CV_32F, 1 where counted, more than 4 px from depth edges, theta < 62 deg, lit

  /// A pixel beside a depth edge: which class it belongs to and the depths on both sides.
  struct EdgePixel {
    int index;  ///< row * width + col
    int cell;   ///< orientation * edge_bins + distance bin, see statistics/edges.cpp
    float fore_mm, back_mm;
  };
  std::vector<EdgePixel> edges;
};

/// One frame with what every segment needs of it, worked out once. Images are CV_32F of the camera's size and 0 where
/// they say nothing; masks are 0 or 1, so that loops need no branches.
struct ObservedFrame {
  int number = 0;
  const Frame* frame = nullptr;
  const Channels* channels = nullptr;
  const CaptureRegions* regions = nullptr;
  int regions_number = 0;  ///< grows whenever the regions change (a moving target)
  cv::Mat residual_mm;     ///< depth - perfect depth of the nominal scene, wherever measured and counted
  cv::Mat measured;        ///< mask: measured and counted
  cv::Mat used;            ///< mask: measured, interior and no outlier
  double centre_mm = 0;    ///< robust middle of the frame's interior residuals
  double scale_mm = 0;     ///< robust standard deviation of the same
  long interior_pixels = 0, outliers = 0;  ///< measured interior pixels; those further from the centre than 8
                                           ///< scale and a coarse step (1 mm, a quarter of a pixel of disparity)

  /// The frame's random part: (residual - previous residual) / sqrt 2, or, in a capture of a single frame, the
  /// difference of horizontal neighbours / sqrt 2 (then `spatial`). Empty in the first of several frames.
  cv::Mat random_mm;
  cv::Mat random_used;  ///< mask of random_mm
  bool spatial = false;
};

/// Values of a segment in one capture. weight is the number of samples behind a value (0 = unknown; the value is then
/// 0 and means nothing). Maps are row-wise rows x cols grids of squares of side_px; other segments have rows = 1.
struct RawStatistic {
  std::vector<float> value;
  /// Samples that a value is of; 0 = it is not known. Frames that repeat another are counted here as if they had been
  /// shown: what a transform makes of the number of samples must not tell how many frames repeat.
  std::vector<float> weight;
  int rows = 1, cols = 0;
  int side_px = 0;  ///< 0 = no map
  bool spatial = false;
};

class Statistic {
 public:
  virtual ~Statistic() = default;
  virtual void add(const ObservedFrame& observed) = 0;
  /// Instead, for a frame that has its predecessor's depth bit by bit, wherever both have one, though these have noise:
  /// it says nothing new of the scene.
  virtual void repeat() {}
  virtual RawStatistic finish() = 0;
};

/// A share of `count` samples, with nearly the same variance wherever it lies: Anscombe (Biometrika 35, 1948), arcsine
/// root of (k + 3/8) / (count + 3/4) for k of them. Without his fractions the first of rare events would make the
/// largest step of all.
float stabilised_share(float share, float count);

/// A segment: what it is, and how to begin it on a capture.
struct SegmentDeclaration {
  std::string name;   ///< the word used everywhere: bias, noise, ...
  std::string group;  ///< bias, noise, spectrum, mask, edges or time: the channel of scores that users see
  std::string unit;   ///< of a difference of stabilised values
  std::string meaning;
  int fewest_frames = 1;
  int passes = 1;
  bool planes_only = false;
  /// Difference of stabilised values below which nothing is worth explaining: added in quadrature to every spread.
  double floor = 0;
  /// Returns null where the capture cannot have this segment (no disparity without a baseline).
  std::unique_ptr<Statistic> (*begin)(const StatisticContext& context) = nullptr;
  /// Where values stand for frequencies: that of value i in cycles per px, 0 = none. Null elsewhere.
  double (*frequency_px)(int i) = nullptr;
  /// Variance-stabilising transform of value i of n and its weight: differences of its results are what counts.
  float (*stabilise)(float raw, float weight, int i, int n) = nullptr;

  /// stabilise(raw) - stabilise(reference), element by element; 0 where either is unknown.
  std::vector<float> transform(const RawStatistic& raw, const RawStatistic& reference) const;
};

/// All segments in a fixed order.
const std::vector<SegmentDeclaration>& segments();
/// Throws Error if there is none of that name.
const SegmentDeclaration& segment(const std::string& name);

/// The perfect channels that the segments read.
ChannelSet statistics_channels();

/// All segments of one capture, frame by frame.
class CaptureStatistics {
 public:
  explicit CaptureStatistics(const StatisticContext& context);
  ~CaptureStatistics();
  /// Frames in order. `channels` are the perfect ones of the nominal scene at that frame (statistics_channels()); a
  /// static capture shares one object. A frame without images (timeout) is skipped. Throws Error if sizes differ.
  /// `regions` are those of the channels where the caller keeps them (they cost more than a frame); made here if null.
  void add(const Frame& frame, std::shared_ptr<const Channels> channels,
           std::shared_ptr<const CaptureRegions> regions = nullptr);
  /// In the order of segments(); an empty entry where the capture cannot have the segment.
  std::vector<RawStatistic> finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The segments; each in its own file of statistics/.
SegmentDeclaration bias_segment();
SegmentDeclaration noise_segment();
SegmentDeclaration dropout_segment();
SegmentDeclaration edges_segment();
SegmentDeclaration spectrum_segment();
SegmentDeclaration shape_segment();
SegmentDeclaration time_segment();
SegmentDeclaration comb_segment();
SegmentDeclaration fixed_pattern_segment();

inline constexpr int edge_orientations = 4, edge_bins = 8;

}  // namespace binrig
