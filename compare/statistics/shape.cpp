// Shape: the distribution of the random part, standardised by the root mean square of its 8 x 8 block in the same
// frame.
#include <cmath>

#include "compare/statistic.h"

namespace binrig {
namespace {

enum Value { kurtosis, skewness, beyond_3, beyond_4, outliers, value_count };
constexpr int block = 8;

class Shape : public Statistic {
 public:
  explicit Shape(const StatisticContext&) {}

  void add(const ObservedFrame& observed) override {
    interior_ += observed.interior_pixels;
    outliers_ += observed.outliers;
    if (observed.random_mm.empty()) return;
    const cv::Mat &d = observed.random_mm, &w = observed.random_used;
    for (int v = 0; v + block <= d.rows; v += block)
      for (int u = 0; u + block <= d.cols; u += block) {
        float s1 = 0, s2 = 0, n = 0;
        for (int y = v; y < v + block; ++y) {
          const float *dy = d.ptr<float>(y), *wy = w.ptr<float>(y);
          for (int x = u; x < u + block; ++x) {
            n += wy[x];
            s1 += dy[x];
            s2 += dy[x] * dy[x];
          }
        }
        if (n < 0.75f * block * block || s2 <= 0) continue;
        const float scale = std::sqrt(n / s2);
        float s3 = 0, s4 = 0, b3 = 0, b4 = 0;
        for (int y = v; y < v + block; ++y) {
          const float* dy = d.ptr<float>(y);
          for (int x = u; x < u + block; ++x) {
            const float t = dy[x] * scale, t2 = t * t;
            s3 += t2 * t;
            s4 += t2 * t2;
            b3 += t2 > 9.f;
            b4 += t2 > 16.f;
          }
        }
        n_ += n;
        s3_ += s3;
        s4_ += s4;
        b3_ += b3;
        b4_ += b4;
      }
  }

  RawStatistic finish() override {
    RawStatistic raw;
    raw.cols = value_count;
    raw.value.assign(value_count, 0.f);
    raw.weight.assign(value_count, 0.f);
    if (n_ > 500) {
      raw.value[kurtosis] = static_cast<float>(s4_ / n_);
      raw.value[skewness] = static_cast<float>(s3_ / n_);
      raw.value[beyond_3] = static_cast<float>(b3_ / n_);
      raw.value[beyond_4] = static_cast<float>(b4_ / n_);
      for (int i = 0; i < outliers; ++i) raw.weight[i] = static_cast<float>(n_);
    }
    if (interior_ > 500) {
      raw.value[outliers] = static_cast<float>(static_cast<double>(outliers_) / interior_);
      raw.weight[outliers] = static_cast<float>(interior_);
    }
    return raw;
  }

 private:
  double n_ = 0, s3_ = 0, s4_ = 0, b3_ = 0, b4_ = 0;
  long interior_ = 0, outliers_ = 0;
};

}  // namespace

SegmentDeclaration shape_segment() {
  SegmentDeclaration s;
  s.name = "shape";
  s.group = "noise";
  s.unit = "ln of kurtosis, skewness, root of a share";
  s.meaning = "kurtosis, skewness, shares beyond 3 and 4 sigma of the locally standardised random part; far outliers";
  s.floor = 0.005;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Shape>(context);
  };
  s.stabilise = [](float raw, float, int i, int) {
    if (i == kurtosis) return std::log(std::max(raw, 0.1f));
    if (i == skewness) return raw;
    return std::sqrt(std::max(raw, 0.f));
  };
  return s;
}

}  // namespace binrig
