// Spectrum: where in frequency the power of the random part lies, as shares of the total. Rings by angles, and the row
// and column ridges apart. Planes only: elsewhere the mask would decide.
#include <cmath>
#include <complex>

#include <opencv2/core.hpp>

#include "compare/statistic.h"
#include "core/spectrum.h"

namespace binrig {
namespace {

constexpr int rings = 10, sectors = 4, ridge_bins = 8;
constexpr int row_ridge = rings * sectors, column_ridge = row_ridge + ridge_bins,
              value_count = column_ridge + ridge_bins;
constexpr double pi = 3.14159265358979323846;

/// -1: counts nowhere.
int bin_of(int i, int j, int rows, int cols) {
  const double fy = dft_frequency(i, rows), fx = dft_frequency(j, cols);
  const double radius = std::hypot(fx, fy);
  if ((i == 0 && j == 0) || radius >= 0.5) return -1;
  const int signed_row = i <= rows / 2 ? i : i - rows;
  if (j <= 1 && std::abs(signed_row) > 2)
    return row_ridge + std::min(ridge_bins - 1, static_cast<int>(2 * ridge_bins * std::abs(fy)));
  if (std::abs(signed_row) <= 1 && j > 2)
    return column_ridge + std::min(ridge_bins - 1, static_cast<int>(2 * ridge_bins * fx));
  double angle = std::atan2(fy, fx) + pi / 8;  // sectors are centred on the axes and diagonals
  if (angle < 0) angle += pi;
  if (angle >= pi) angle -= pi;
  return std::min(rings - 1, static_cast<int>(2 * rings * radius)) * sectors +
         std::min(sectors - 1, static_cast<int>(angle / pi * sectors));
}
FrequencyBins all_bins(bin_of);

class Spectrum : public Statistic {
 public:
  explicit Spectrum(const StatisticContext& context)
      : fft_(context.camera.height, context.camera.width), bin_(all_bins.of(fft_.rows(), fft_.cols())) {
    power_.assign(value_count, 0);
  }

  void add(const ObservedFrame& observed) override {
    if (observed.random_mm.empty()) return;
    if (cv::sum(observed.random_used)[0] < 0.5 * static_cast<double>(observed.random_used.total())) return;
    fft_.forward(observed.random_mm, line_);
    for (std::size_t p = 0; p < bin_.size(); ++p)
      if (bin_[p] >= 0) power_[bin_[p]] += std::norm(line_[p]);
    frames_ += 1;
  }

  RawStatistic finish() override {
    RawStatistic raw;
    raw.cols = value_count;
    raw.value.assign(value_count, 0.f);
    raw.weight.assign(value_count, 0.f);
    double total = 0;
    for (double p : power_) total += p;
    if (frames_ == 0 || total <= 0) return raw;
    for (int i = 0; i < value_count; ++i) {
      raw.value[i] = static_cast<float>(power_[i] / total);
      raw.weight[i] = static_cast<float>(frames_);
    }
    return raw;
  }

 private:
  Fft2 fft_;
  const std::vector<int>& bin_;
  std::vector<std::complex<float>> line_;
  std::vector<double> power_;
  int frames_ = 0;
};

}  // namespace

SegmentDeclaration spectrum_segment() {
  SegmentDeclaration s;
  s.name = "spectrum";
  s.group = "spectrum";
  s.unit = "ln of a share of the power";
  s.meaning = "power of the random part by radius and angle of its frequency, rows and columns apart";
  s.planes_only = true;
  s.floor = 0.06;  // models of noise differ by as much in kind (drawn or fixed magnitudes) without anybody minding
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Spectrum>(context);
  };
  s.stabilise = [](float raw, float, int, int) { return std::log(raw + 1e-9f); };
  s.frequency_px = [](int i) { return i < row_ridge ? (i / sectors + 0.5) / (2 * rings) : 0; };
  return s;
}

}  // namespace binrig
