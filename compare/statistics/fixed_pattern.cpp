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

/// What stays is what even and odd frames share: their cross power has no part of the frames' own noise, however few
/// they are. A capture of one frame has its plain power.
class FixedPattern : public Statistic {
 public:
  explicit FixedPattern(const StatisticContext& context) {
    for (Half& half : halves_) {
      half.sum = cv::Mat::zeros(context.camera.height, context.camera.width, CV_32F);
      half.count = half.sum.clone();
    }
  }

  void add(const ObservedFrame& observed) override {
    Half& half = halves_[observed.number % 2];
    float *s = half.sum.ptr<float>(), *n = half.count.ptr<float>();
    const float *r = observed.residual_mm.ptr<float>(), *w = observed.used.ptr<float>();
    const float centre = static_cast<float>(observed.centre_mm);
    for (std::size_t p = 0; p < half.sum.total(); ++p) {
      s[p] += w[p] * (r[p] - centre);
      n[p] += w[p];
    }
    ++half.frames;
  }

  RawStatistic finish() override {
    RawStatistic raw;
    raw.cols = value_count;
    raw.value.assign(value_count, 0.f);
    raw.weight.assign(value_count, 0.f);
    if (halves_[0].frames == 0) return raw;
    Half& a = halves_[0];
    Half& b = halves_[1].frames > 0 ? halves_[1] : halves_[0];
    cv::Mat mask = cv::Mat::zeros(a.sum.size(), CV_32F);
    double known = 0;
    for (std::size_t p = 0; p < mask.total(); ++p)
      if (a.count.ptr<float>()[p] >= 0.5f * a.frames && b.count.ptr<float>()[p] >= 0.5f * b.frames)
        mask.ptr<float>()[p] = 1, known += 1;
    if (known < 0.3 * mask.total()) return raw;
    const cv::Mat first = high_passed(a, mask), second = &a == &b ? first : high_passed(b, mask);

    std::vector<std::complex<float>> x, y;
    const Fft2 fft(mask.rows, mask.cols);
    fft.forward(first, x);
    fft.forward(second, y);
    std::vector<double> power(rings, 0), number(rings, 0);
    const int columns = fft.half_cols();
    for (int i = 0; i < mask.rows; ++i)
      for (int j = 0; j < columns; ++j) {
        const int ring = band_of(std::hypot(dft_frequency(i, mask.rows), dft_frequency(j, mask.cols)), rings);
        if (ring < 0) continue;
        const std::size_t k = static_cast<std::size_t>(i) * columns + j;
        power[ring] += (x[k] * std::conj(y[k])).real();
        number[ring] += 1;
      }
    for (int k = 0; k < rings; ++k)
      if (number[k] > 0) {
        raw.value[k] = static_cast<float>(power[k] / number[k] / known);
        raw.weight[k] = static_cast<float>(number[k]);
      }
    lines(first, second, mask, raw, rings);
    lines(first.t(), second.t(), mask.t(), raw, rings + line_bands);
    return raw;
  }

 private:
  struct Half {
    cv::Mat sum, count;
    int frames = 0;
  };

  static cv::Mat high_passed(const Half& half, const cv::Mat& mask) {
    cv::Mat map = cv::Mat::zeros(mask.size(), CV_32F), smooth, share;
    for (std::size_t p = 0; p < map.total(); ++p)
      if (mask.ptr<float>()[p] > 0) map.ptr<float>()[p] = half.sum.ptr<float>()[p] / half.count.ptr<float>()[p];
    cv::blur(map, smooth, {high_pass_px, high_pass_px}, {-1, -1}, cv::BORDER_CONSTANT);
    cv::blur(mask, share, {high_pass_px, high_pass_px}, {-1, -1}, cv::BORDER_CONSTANT);
    for (std::size_t p = 0; p < map.total(); ++p)
      if (mask.ptr<float>()[p] > 0) map.ptr<float>()[p] -= smooth.ptr<float>()[p] / share.ptr<float>()[p];
    return map;
  }

  static std::vector<std::complex<float>> profile_spectrum(const cv::Mat& map, const cv::Mat& mask) {
    cv::Mat profile = cv::Mat::zeros(1, map.cols, CV_32F);
    for (int u = 0; u < map.cols; ++u) {
      double sum = 0, count = 0;
      for (int v = 0; v < map.rows; ++v) {
        sum += map.at<float>(v, u);
        count += mask.at<float>(v, u);
      }
      if (count > 0.3 * map.rows) profile.at<float>(u) = static_cast<float>(sum / count);
    }
    std::vector<std::complex<float>> line;
    Fft2(1, map.cols).forward(profile, line);
    return line;
  }

  /// Strongest line of the means of columns by band: half the square of its amplitude, mm^2.
  static void lines(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, RawStatistic& raw, int at) {
    const int n = mask.cols;
    const auto x = profile_spectrum(first, mask), y = profile_spectrum(second, mask);
    for (int j = 1; j <= n / 2; ++j) {
      const int band = band_of(dft_frequency(j, n), line_bands);
      if (band < 0) continue;
      const float power = 2 * (x[j] * std::conj(y[j])).real() / n / n;
      raw.value[at + band] = raw.weight[at + band] > 0 ? std::max(raw.value[at + band], power) : power;
      raw.weight[at + band] += 1;
    }
  }

  Half halves_[2];
};

}  // namespace

SegmentDeclaration fixed_pattern_segment() {
  SegmentDeclaration s;
  s.name = "fixed pattern";
  s.group = "bias";
  s.unit = "asinh of a power, in (0.02 mm)^2 (rings) or (0.002 mm)^2 (lines)";
  s.meaning = "power of what stays through a capture, in rings of frequency and in lines along columns and rows";
  s.planes_only = true;
  s.floor = 0.1;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<FixedPattern>(context);
  };
  s.stabilise = [](float raw, int i, int) { return std::asinh(raw / (i < rings ? 4e-4f : 4e-6f)); };
  return s;
}

}  // namespace binrig
