// Fixed pattern: what stays through a capture, by power: of the high-passed mean residual in rings, of the strongest
// line of its column and row means by band of frequency, and, for slow patterns, how cells near and far go together. A
// map that differs from unit to unit shows here and in no mean. Planes only.
#include <cmath>
#include <complex>

#include <Eigen/Cholesky>
#include <opencv2/imgproc.hpp>

#include "compare/statistic.h"
#include "compare/statistics/grid.h"
#include "core/spectrum.h"

namespace binrig {
namespace {

constexpr int rings = 12, line_bands = 16;
constexpr int lags = 4;  // 0, 1/16, 1/8, 1/4 of the image's width
constexpr int first_lag = rings + 2 * line_bands, value_count = first_lag + lags;
constexpr int high_pass_px = 41;
constexpr double lowest = 1.0 / 80;  // cycles/px; slower ones are the bias map's

int band_of(double frequency, int bands) {
  if (frequency < lowest || frequency > 0.5) return -1;
  return std::min(bands - 1, static_cast<int>(bands * std::log(frequency / lowest) / std::log(0.5 / lowest)));
}

FrequencyBins all_rings([](int i, int j, int rows, int cols) {
  return band_of(std::hypot(dft_frequency(i, rows), dft_frequency(j, cols)), rings);
});

/// What stays is what even and odd frames share: their cross power has no part of the frames' own noise, however few
/// they are. A capture of one frame has its plain power.
class FixedPattern : public Statistic {
 public:
  explicit FixedPattern(const StatisticContext& context) : grid_(context, context.cell_px()) {
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
    const int count = static_cast<int>(half.sum.total());
    for (int p = 0; p < count; ++p) {
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
    const cv::Mat mask = known_in(a, b);
    const double known = cv::sum(mask)[0];
    if (known < 0.3 * mask.total()) return raw;
    cv::Mat share;
    cv::blur(mask, share, {high_pass_px, high_pass_px}, {-1, -1}, cv::BORDER_CONSTANT);
    const cv::Mat first = high_passed(a, mask, share), second = &a == &b ? first : high_passed(b, mask, share);

    std::vector<std::complex<float>> x, y;
    const Fft2 fft(mask.rows, mask.cols);
    fft.forward(first, x);
    fft.forward(second, y);
    std::vector<double> power(rings, 0), number(rings, 0);
    const std::vector<int>& ring = all_rings.of(mask.rows, mask.cols);
    for (std::size_t k = 0; k < ring.size(); ++k) {
      if (ring[k] < 0) continue;
      power[ring[k]] += x[k].real() * y[k].real() + x[k].imag() * y[k].imag();
      number[ring[k]] += 1;
    }
    for (int k = 0; k < rings; ++k)
      if (number[k] > 0) {
        raw.value[k] = static_cast<float>(power[k] / number[k] / known);
        raw.weight[k] = static_cast<float>(number[k]);
      }
    lines(first, second, mask, raw, rings);
    lines(first.t(), second.t(), mask.t(), raw, rings + line_bands);
    slow(a, b, mask, raw);
    return raw;
  }

 private:
  struct Half {
    cv::Mat sum, count;
    int frames = 0;
  };

  /// Cells of the two halves without what a plane's pose and the lens can do (a polynomial of second order), and how
  /// cells go together that lie apart by a lag along rows or columns, mm^2.
  void slow(const Half& a, const Half& b, const cv::Mat& mask, RawStatistic& raw) const {
    std::vector<double> sums[2], counts[2];
    for (int h = 0; h < 2; ++h) {
      sums[h].resize(grid_.size());
      counts[h].resize(grid_.size());
      const Half& half = h == 0 ? a : b;
      grid_.add(half.sum, mask, sums[h]);
      grid_.add(half.count, mask, counts[h]);
    }
    const int rows = grid_.rows(), cols = grid_.cols();
    const auto known = [&](int cell) { return counts[0][cell] > 0 && counts[1][cell] > 0; };
    const auto terms = [&](int cell) {
      const double x = 2.0 * (cell % cols) / cols - 1, y = 2.0 * (cell / cols) / rows - 1;
      return Eigen::Matrix<double, 6, 1>{1, x, y, x * x, x * y, y * y};
    };
    std::vector<double> rest[2];
    for (int h = 0; h < 2; ++h) {
      Eigen::Matrix<double, 6, 6> normal = 1e-9 * Eigen::Matrix<double, 6, 6>::Identity();
      Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
      for (int i = 0; i < grid_.size(); ++i) {
        if (!known(i)) continue;
        const auto t = terms(i);
        normal += t * t.transpose();
        right += t * (sums[h][i] / counts[h][i]);
      }
      const Eigen::Matrix<double, 6, 1> c = normal.ldlt().solve(right);
      rest[h].resize(grid_.size(), 0);
      for (int i = 0; i < grid_.size(); ++i)
        if (known(i)) rest[h][i] = sums[h][i] / counts[h][i] - terms(i).dot(c);
    }
    for (int k = 0; k < lags; ++k) {
      const int lag = k == 0 ? 0 : std::max(k, cols >> (5 - k));
      double sum = 0, count = 0;
      for (int r = 0; r < rows; ++r)
        for (int q = 0; q < cols; ++q) {
          const int i = r * cols + q;
          if (!known(i)) continue;
          for (const int j : {q + lag < cols ? i + lag : -1, r + lag < rows ? i + lag * cols : -1}) {
            if (j < 0 || !known(j)) continue;
            sum += rest[0][i] * rest[1][j] + rest[1][i] * rest[0][j];
            count += 2;
          }
        }
      if (count < 100) continue;
      raw.value[first_lag + k] = static_cast<float>(sum / count);
      raw.weight[first_lag + k] = static_cast<float>(count);
    }
  }

  /// 1 where both halves have depth in at least half of their frames.
  static cv::Mat known_in(const Half& a, const Half& b) {
    cv::Mat mask(a.sum.size(), CV_32F);
    const int count = static_cast<int>(mask.total());
    const float *in_a = a.count.ptr<float>(), *in_b = b.count.ptr<float>();
    const float least_a = 0.5f * static_cast<float>(a.frames), least_b = 0.5f * static_cast<float>(b.frames);
    float* known = mask.ptr<float>();
    for (int p = 0; p < count; ++p) known[p] = in_a[p] >= least_a && in_b[p] >= least_b ? 1.f : 0.f;
    return mask;
  }

  /// Mean residual less its mean over a square, both over what the mask knows. `share`: the mask's mean over the
  /// square.
  static cv::Mat high_passed(const Half& half, const cv::Mat& mask, const cv::Mat& share) {
    cv::Mat map(mask.size(), CV_32F), smooth;
    const int count = static_cast<int>(map.total());
    const float *known = mask.ptr<float>(), *sum = half.sum.ptr<float>(), *n = half.count.ptr<float>();
    float* m = map.ptr<float>();
    for (int p = 0; p < count; ++p) m[p] = known[p] > 0 ? sum[p] / std::max(1.f, n[p]) : 0.f;
    cv::blur(map, smooth, {high_pass_px, high_pass_px}, {-1, -1}, cv::BORDER_CONSTANT);
    const float *mean = smooth.ptr<float>(), *part = share.ptr<float>();
    for (int p = 0; p < count; ++p) m[p] -= known[p] > 0 ? mean[p] / std::max(part[p], 1e-6f) : 0.f;
    return map;
  }

  static std::vector<std::complex<float>> profile_spectrum(const cv::Mat& map, const cv::Mat& mask) {
    cv::Mat profile = cv::Mat::zeros(1, map.cols, CV_32F);
    cv::Mat sum, count;
    cv::reduce(map, sum, 0, cv::REDUCE_SUM, CV_32F);
    cv::reduce(mask, count, 0, cv::REDUCE_SUM, CV_32F);
    for (int u = 0; u < map.cols; ++u)
      if (const float n = count.at<float>(u); n > 0.3f * static_cast<float>(map.rows))
        profile.at<float>(u) = sum.at<float>(u) / n;
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

  Grid grid_;
  Half halves_[2];
};

}  // namespace

SegmentDeclaration fixed_pattern_segment() {
  SegmentDeclaration s;
  s.name = "fixed pattern";
  s.group = "bias";
  s.unit = "asinh of a power, in (0.02 mm)^2 (rings, cells) or (0.002 mm)^2 (lines)";
  s.meaning =
      "power of what stays through a capture: in rings of frequency, in lines along columns and rows, and of cells "
      "near "
      "and far";
  s.planes_only = true;
  s.floor = 0.1;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<FixedPattern>(context);
  };
  s.stabilise = [](float raw, float, int i, int) {
    return std::asinh(raw / (i < rings || i >= first_lag ? 4e-4f : 4e-6f));
  };
  return s;
}

}  // namespace binrig
