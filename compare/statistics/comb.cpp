// Comb: modulus of the characteristic function of disparity and of depth over the interior. Quantisation and locking
// stand out as lines whatever the target's shape. Only the strongest line of each band of frequencies is kept, so that
// the step need not be known.
//
// Folding the values first makes this a histogram and one short DFT: the characteristic function at multiples of
// 1/period sees the value modulo the period only.
#include <cmath>
#include <complex>
#include <numeric>

#include "compare/statistic.h"
#include "core/spectrum.h"

namespace binrig {
namespace {

constexpr int disparity_size = 4096, depth_size = 8192;
constexpr float disparity_bin_px = 1.f / 1024, depth_bin_mm = 0.01f;  // folded at 4 px and at 81.92 mm
constexpr int disparity_bands = 22, depth_bands = 26;

/// Lines of a histogram's DFT, in bands that are equally wide on a logarithmic scale.
struct Bands {
  Bands(int lowest_line, int highest_line, int count) : lowest(lowest_line), lines(count, 0) {
    const double step = std::log(static_cast<double>(highest_line + 1) / lowest) / count;
    for (int m = lowest; m <= highest_line; ++m) {
      of.push_back(std::min(count - 1, static_cast<int>(std::log(static_cast<double>(m) / lowest) / step)));
      ++lines[of.back()];
    }
  }
  int lowest;
  std::vector<int> of;     ///< of line lowest + i
  std::vector<int> lines;  ///< in each band
};
const Bands disparity_lines(2, 300, disparity_bands);  // 0.5 .. 75 cycles per px
const Bands depth_lines(6, 4096, depth_bands);         // 0.07 .. 50 cycles per mm

std::vector<double> strongest(const std::vector<float>& histogram, double total, const Bands& bands) {
  const int n = static_cast<int>(histogram.size());
  std::vector<std::complex<float>> line;
  Fft2(1, n).forward(cv::Mat(1, n, CV_32F, const_cast<float*>(histogram.data())), line);
  std::vector<double> result(bands.lines.size(), 0);
  for (std::size_t i = 0; i < bands.of.size(); ++i) {
    double& highest = result[bands.of[i]];
    highest = std::max(highest, static_cast<double>(std::norm(line[bands.lowest + i])));
  }
  // The strongest of n lines of pure chance has a squared modulus of (ln n + 0.58) / samples: taken off, so that the
  // value does not depend on how many frames there are.
  for (std::size_t b = 0; b < result.size(); ++b)
    if (bands.lines[b] > 0)
      result[b] = std::sqrt(std::max(0.0, result[b] / total / total - (std::log(bands.lines[b]) + 0.58) / total));
  return result;
}

class Comb : public Statistic {
 public:
  explicit Comb(const StatisticContext& context)
      : focal_baseline_(static_cast<float>(context.focal_baseline)),
        disparity_(disparity_size, 0.f),
        depth_(depth_size, 0.f) {}

  void add(const ObservedFrame& observed) override {
    const float *z = observed.frame->depth_mm.ptr<float>(), *w = observed.used.ptr<float>();
    const int count = static_cast<int>(observed.used.total());
    constexpr float depth_per_bin = 1 / depth_bin_mm;
    const float disparity_scale = focal_baseline_ / disparity_bin_px;
    constexpr int piece = 1024;
    int depth_bin[piece], disparity_bin[piece];
    for (int first = 0; first < count; first += piece) {
      const int size = std::min(piece, count - first);
      const float *depth = z + first, *used = w + first;
      for (int i = 0; i < size; ++i) {
        depth_bin[i] = static_cast<int>(depth[i] * depth_per_bin + 0.5f) & (depth_size - 1);
        disparity_bin[i] = static_cast<int>(disparity_scale / std::max(depth[i], 1.f)) & (disparity_size - 1);
      }
      for (int i = 0; i < size; ++i) {
        depth_[depth_bin[i]] += used[i];
        disparity_[disparity_bin[i]] += used[i];
      }
      total_ += std::accumulate(used, used + size, 0.f);
    }
  }

  RawStatistic finish() override {
    RawStatistic raw;
    raw.cols = disparity_bands + depth_bands;
    raw.value.assign(raw.cols, 0.f);
    raw.weight.assign(raw.cols, 0.f);
    if (total_ < 2000) return raw;
    const auto depth = strongest(depth_, total_, depth_lines);
    for (int i = 0; i < depth_bands; ++i) {
      raw.value[disparity_bands + i] = static_cast<float>(depth[i]);
      raw.weight[disparity_bands + i] = static_cast<float>(total_);
    }
    if (focal_baseline_ <= 0) return raw;
    const auto disparity = strongest(disparity_, total_, disparity_lines);
    for (int i = 0; i < disparity_bands; ++i) {
      raw.value[i] = static_cast<float>(disparity[i]);
      raw.weight[i] = static_cast<float>(total_);
    }
    return raw;
  }

 private:
  float focal_baseline_;
  std::vector<float> disparity_, depth_;
  double total_ = 0;
};

}  // namespace

SegmentDeclaration comb_segment() {
  SegmentDeclaration s;
  s.name = "comb";
  s.group = "spectrum";
  s.unit = "ln of a modulus";
  s.meaning = "strongest line of the histograms of disparity and depth, by band of frequency";
  s.floor = 0.1;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Comb>(context);
  };
  s.stabilise = [](float raw, float, int, int) { return std::log(raw + 0.01f); };
  return s;
}

}  // namespace binrig
