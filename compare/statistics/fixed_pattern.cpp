// Fixed pattern: what stays through a capture and is finer than the bias map's bins: power of the high-passed mean
// residual in rings, and the strongest line of its column and row means by band of frequency. Planes only.
#include <cmath>
#include <complex>

#include <opencv2/imgproc.hpp>

#include "compare/statistic.h"
#include "core/spectrum.h"

namespace binrig {
namespace {

constexpr int rings = 12, line_bands = 16, value_count = rings + 2 * line_bands;
constexpr int high_pass_px = 41;
constexpr double lowest = 1.0 / 80;  // cycles/px; slower ones are the bias map's

int band_of(double frequency, int bands) {
  if (frequency < lowest || frequency > 0.5) return -1;
  return std::min(bands - 1, static_cast<int>(bands * std::log(frequency / lowest) / std::log(0.5 / lowest)));
}

class FixedPattern : public Statistic {
 public:
  explicit FixedPattern(const StatisticContext& context)
      : frames_(context.frames),
        sum_(cv::Mat::zeros(context.camera.height, context.camera.width, CV_32F)),
        count_(cv::Mat::zeros(context.camera.height, context.camera.width, CV_32F)) {}

  void add(const ObservedFrame& observed) override {
    float *s = sum_.ptr<float>(), *n = count_.ptr<float>();
    const float *r = observed.residual_mm.ptr<float>(), *w = observed.used.ptr<float>();
    const float centre = static_cast<float>(observed.centre_mm);
    for (std::size_t p = 0; p < sum_.total(); ++p) {
      s[p] += w[p] * (r[p] - centre);
      n[p] += w[p];
    }
  }

  RawStatistic finish() override {
    RawStatistic raw;
    raw.cols = value_count;
    raw.value.assign(value_count, 0.f);
    raw.weight.assign(value_count, 0.f);
    cv::Mat mask = cv::Mat::zeros(sum_.size(), CV_32F), map = cv::Mat::zeros(sum_.size(), CV_32F);
    double known = 0;
    for (std::size_t p = 0; p < sum_.total(); ++p)
      if (count_.ptr<float>()[p] >= 0.5f * frames_) {
        mask.ptr<float>()[p] = 1;
        map.ptr<float>()[p] = sum_.ptr<float>()[p] / count_.ptr<float>()[p];
        known += 1;
      }
    if (known < 0.3 * sum_.total()) return raw;
    cv::Mat smooth, share;
    cv::blur(map, smooth, {high_pass_px, high_pass_px}, {-1, -1}, cv::BORDER_CONSTANT);
    cv::blur(mask, share, {high_pass_px, high_pass_px}, {-1, -1}, cv::BORDER_CONSTANT);
    for (std::size_t p = 0; p < map.total(); ++p)
      if (mask.ptr<float>()[p] > 0) map.ptr<float>()[p] -= smooth.ptr<float>()[p] / share.ptr<float>()[p];

    std::vector<std::complex<float>> spectrum;
    Fft2(map.rows, map.cols).forward(map, spectrum);
    std::vector<double> power(rings, 0), number(rings, 0);
    const int half = map.cols / 2 + 1;
    for (int i = 0; i < map.rows; ++i)
      for (int j = 0; j < half; ++j) {
        const int ring = band_of(std::hypot(dft_frequency(i, map.rows), dft_frequency(j, map.cols)), rings);
        if (ring < 0) continue;
        power[ring] += std::norm(spectrum[static_cast<std::size_t>(i) * half + j]);
        number[ring] += 1;
      }
    for (int k = 0; k < rings; ++k)
      if (number[k] > 0) {
        raw.value[k] = static_cast<float>(power[k] / number[k] / known);
        raw.weight[k] = static_cast<float>(number[k]);
      }
    lines(map, mask, raw, rings);
    lines(map.t(), mask.t(), raw, rings + line_bands);
    return raw;
  }

 private:
  /// Strongest line of the means of columns, mm^2 per pixel of a column (so that white noise gives its variance).
  static void lines(const cv::Mat& map, const cv::Mat& mask, RawStatistic& raw, int first) {
    const int n = map.cols;
    cv::Mat profile = cv::Mat::zeros(1, n, CV_32F);
    for (int u = 0; u < n; ++u) {
      double sum = 0, count = 0;
      for (int v = 0; v < map.rows; ++v) {
        sum += map.at<float>(v, u);
        count += mask.at<float>(v, u);
      }
      if (count > 0.3 * map.rows) profile.at<float>(u) = static_cast<float>(sum / std::sqrt(count));
    }
    std::vector<std::complex<float>> line;
    Fft2(1, n).forward(profile, line);
    for (int j = 1; j <= n / 2; ++j) {
      const int band = band_of(dft_frequency(j, n), line_bands);
      if (band < 0) continue;
      raw.value[first + band] = std::max(raw.value[first + band], std::norm(line[j]) / n);
      raw.weight[first + band] += 1;
    }
  }

  int frames_;
  cv::Mat sum_, count_;
};

}  // namespace

SegmentDeclaration fixed_pattern_segment() {
  SegmentDeclaration s;
  s.name = "fixed pattern";
  s.group = "bias";
  s.unit = "ln of a power";
  s.meaning = "power of what stays through a capture, in rings of frequency and in lines along columns and rows";
  s.planes_only = true;
  s.floor = 0.1;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<FixedPattern>(context);
  };
  s.stabilise = [](float raw, int, int) { return std::log(raw + 1e-7f); };
  return s;
}

}  // namespace binrig
