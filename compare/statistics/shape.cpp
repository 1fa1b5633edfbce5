// Shape: the distribution of the random part, standardised by the root mean square of its 8 x 8 block in the same
// frame.
#include <cmath>
#include <numeric>

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
        float n[block] = {}, s2[block] = {}, s3[block] = {}, s4[block] = {}, b3[block] = {}, b4[block] = {};  // columns
        for (int y = v; y < v + block; ++y) {
          const float *dy = d.ptr<float>(y) + u, *wy = w.ptr<float>(y) + u;
          for (int x = 0; x < block; ++x) {
            n[x] += wy[x];
            s2[x] += dy[x] * dy[x];
          }
        }
        const float count = total(n), square = total(s2);
        if (count < 0.75f * block * block || square <= 0) continue;
        const float scale = std::sqrt(count / square);
        for (int y = v; y < v + block; ++y) {
          const float* dy = d.ptr<float>(y) + u;
          for (int x = 0; x < block; ++x) {
            const float t = dy[x] * scale, t2 = t * t;
            s3[x] += t2 * t;
            s4[x] += t2 * t2;
            b3[x] += t2 > 9.f ? 1.f : 0.f;
            b4[x] += t2 > 16.f ? 1.f : 0.f;
          }
        }
        n_ += count;
        s3_ += total(s3);
        s4_ += total(s4);
        b3_ += total(b3);
        b4_ += total(b4);
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
  static float total(const float (&columns)[block]) { return std::accumulate(columns, columns + block, 0.f); }

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
