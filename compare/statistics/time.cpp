// Time: what happens from frame to frame. Whole-frame offset and tilts, the offset's course, how alike frames are that
// lie one, two and three apart, repeated frames, rows and columns that move together, holes that stay.
#include <array>
#include <cmath>

#include "compare/statistic.h"

namespace binrig {
namespace {

constexpr int course_bins = 6;
enum Value {
  offset_variance,  // of the frame's mean, mm^2, from successive differences
  tilt_x_variance,  // of the depth at the image's edge due to tilt, mm^2
  tilt_y_variance,
  course,  // mean residual in each of 6 equal spans of the capture minus that of the whole capture, mm
  lag_2 = course + course_bins,  // mean squared difference two frames apart over that of one apart
  lag_3,
  repeated,      // share of frames that equal their predecessor
  row_variance,  // variance of row means of the random part over what independent pixels would give
  column_variance,
  holes_stay,       // share of a frame's holes that are holes in the next
  flicker,          // share of pixels that change between hole and depth
  motion_response,  // residual per nominal change since the last frame
  value_count
};

class Time : public Statistic {
 public:
  explicit Time(const StatisticContext& context) : context_(context) {
    const ImageCoordinates at(context.camera);
    for (int u = 0; u < context.camera.width; ++u) x_.push_back(static_cast<float>(at.x(u)));
    for (int v = 0; v < context.camera.height; ++v) y_.push_back(static_cast<float>(at.y(v)));
  }

  void add(const ObservedFrame& observed) override {
    ++frames_;
    whole_frame(observed);
    if (past_[0].residual.data) pairs(observed);
    past_[2] = past_[1];
    past_[1] = past_[0];
    past_[0] = {observed.residual_mm, observed.used, observed.measured, observed.channels->depth_mm};
  }

  void repeat() override { ++left_out_; }

  RawStatistic finish() override {
    raw_.cols = value_count;
    raw_.value.assign(value_count, 0.f);
    raw_.weight.assign(value_count, 0.f);
    const int n = static_cast<int>(mean_.size());
    for (int k = 0; k < 3; ++k) {
      const auto& series = k == 0 ? mean_ : k == 1 ? tilt_x_ : tilt_y_;
      double sum = 0;
      for (int t = 1; t < n; ++t) sum += 0.5 * (series[t] - series[t - 1]) * (series[t] - series[t - 1]);
      if (n >= 2) set(offset_variance + k, sum / (n - 1), n - 1);
    }
    if (n >= course_bins) {
      double all = 0;
      for (double m : mean_) all += m / n;
      for (int b = 0; b < course_bins; ++b) {
        double sum = 0;
        int count = 0;
        for (int t = b * n / course_bins; t < (b + 1) * n / course_bins; ++t, ++count) sum += mean_[t];
        set(course + b, sum / count - all, count);
      }
    }
    for (int lag = 2; lag <= 3; ++lag)
      if (lag_count_[lag] > 1000 && lag_count_[1] > 1000 && lag_sum_[1] > 0)
        set(lag_2 + lag - 2, (lag_sum_[lag] / lag_count_[lag]) / (lag_sum_[1] / lag_count_[1]), lag_count_[lag]);
    const int all = frames_ + left_out_;
    if (all >= 2) set(repeated, static_cast<double>(repeats_ + left_out_) / (all - 1), all - 1);
    if (row_count_ > 0) set(row_variance, row_sum_ / row_count_, row_count_);
    if (column_count_ > 0) set(column_variance, column_sum_ / column_count_, column_count_);
    if (holes_ > 200) set(holes_stay, holes_stay_ / holes_, holes_);
    if (counted_ > 0) set(flicker, changes_ / counted_, counted_);
    if (context_.motion && motion_square_ > 1) set(motion_response, motion_product_ / motion_square_, motion_square_);
    return raw_;
  }

 private:
  struct Past {
    cv::Mat residual, used, measured, nominal;
  };

  void set(int i, double value, double weight) {
    raw_.value[i] = static_cast<float>(value);
    raw_.weight[i] = static_cast<float>(weight);
  }

  void whole_frame(const ObservedFrame& observed) {
    double n = 0, r = 0, x = 0, y = 0, xx = 0, yy = 0, rx = 0, ry = 0;
    for (int v = 0; v < observed.used.rows; ++v) {
      const float *a = observed.residual_mm.ptr<float>(v), *w = observed.used.ptr<float>(v);
      float ln = 0, lr = 0, lx = 0, lxx = 0, lrx = 0;
#pragma omp simd reduction(+ : ln, lr, lx, lxx, lrx)
      for (int u = 0; u < observed.used.cols; ++u) {
        const float wx = w[u] * x_[u];
        ln += w[u];
        lr += w[u] * a[u];
        lx += wx;
        lxx += wx * x_[u];
        lrx += wx * a[u];
      }
      n += ln, r += lr, x += lx, xx += lxx, rx += lrx;
      y += ln * y_[v], yy += ln * y_[v] * y_[v], ry += lr * y_[v];
    }
    if (n < 100) return;
    mean_.push_back(r / n);
    tilt_x_.push_back((rx - r * x / n) / std::max(1e-9, xx - x * x / n));
    tilt_y_.push_back((ry - r * y / n) / std::max(1e-9, yy - y * y / n));
  }

  void pairs(const ObservedFrame& observed) {
    const int count = static_cast<int>(observed.used.total());
    const float *r = observed.residual_mm.ptr<float>(), *w = observed.used.ptr<float>();
    for (int lag = 1; lag <= 3; ++lag) {
      const Past& past = past_[lag - 1];
      if (!past.residual.data) break;
      const float *before = past.residual.ptr<float>(), *used = past.used.ptr<float>();
      double total = 0, number = 0;
      constexpr int piece = 4096;  // summed in single precision
      for (int first = 0; first < count; first += piece) {
        float sum = 0, n = 0;
        const int last = std::min(count, first + piece);
#pragma omp simd reduction(+ : sum, n)
        for (int p = first; p < last; ++p) {
          const float both = w[p] * used[p], d = r[p] - before[p];
          sum += both * d * d;
          n += both;
        }
        total += sum;
        number += n;
      }
      lag_sum_[lag] += total;
      lag_count_[lag] += number;
      if (lag == 1 && number > 100 && total == 0) ++repeats_;
    }
    const Past& past = past_[0];
    const float *m = observed.measured.ptr<float>(), *m0 = past.measured.ptr<float>();
    const float* counted = observed.regions->counted.ptr<float>();
    float holes = 0, stay = 0, changes = 0, all = 0;  // whole numbers
#pragma omp simd reduction(+ : holes, stay, changes, all)
    for (int p = 0; p < count; ++p) {
      const float hole0 = counted[p] - m0[p] * counted[p], hole = counted[p] - m[p];
      holes += hole0;
      stay += hole0 * hole;
      changes += std::abs(hole - hole0);
      all += counted[p];
    }
    holes_ += holes, holes_stay_ += stay, changes_ += changes, counted_ += all;
    if (!observed.random_mm.empty()) rows_and_columns(observed);
    if (context_.motion) {
      const float *nominal = observed.channels->depth_mm.ptr<float>(), *nominal0 = past.nominal.ptr<float>();
      for (int p = 0; p < count; ++p) {
        if (w[p] == 0 || nominal0[p] <= 0) continue;
        const double change = nominal[p] - nominal0[p];
        if (std::abs(change) > 20) continue;  // another surface
        motion_product_ += change * (r[p] - observed.centre_mm);
        motion_square_ += change * change;
      }
    }
  }

  void rows_and_columns(const ObservedFrame& observed) {
    const cv::Mat &d = observed.random_mm, &w = observed.random_used;
    std::vector<float> column(d.cols, 0.f), column_n(d.cols, 0.f);
    std::vector<double> row(d.rows), row_n(d.rows);
    double square = 0, n = 0, sum = 0;
    for (int v = 0; v < d.rows; ++v) {
      const float *a = d.ptr<float>(v), *b = w.ptr<float>(v);
      float s = 0, c = 0, q = 0;
#pragma omp simd reduction(+ : s, c, q)
      for (int u = 0; u < d.cols; ++u) {
        s += a[u];
        c += b[u];
        q += a[u] * a[u];
        column[u] += a[u];
        column_n[u] += b[u];
      }
      row[v] = s, row_n[v] = c;
      square += q, n += c, sum += s;
    }
    if (n < 1000 || square <= 0) return;
    const double mean = sum / n, variance = square / n;
    for (int v = 0; v < d.rows; ++v)
      if (row_n[v] > 0.3 * d.cols) {
        row_sum_ += std::pow(row[v] / row_n[v] - mean, 2) * row_n[v] / variance;
        row_count_ += 1;
      }
    for (int u = 0; u < d.cols; ++u)
      if (column_n[u] > 0.3 * d.rows) {
        column_sum_ += std::pow(column[u] / column_n[u] - mean, 2) * column_n[u] / variance;
        column_count_ += 1;
      }
  }

  StatisticContext context_;
  std::vector<float> x_, y_;
  std::array<Past, 3> past_;
  std::vector<double> mean_, tilt_x_, tilt_y_;
  double lag_sum_[4] = {}, lag_count_[4] = {};
  int frames_ = 0, repeats_ = 0, left_out_ = 0;  // seen; of these equal without noise; repeats that were not shown
  double row_sum_ = 0, row_count_ = 0, column_sum_ = 0, column_count_ = 0;
  double holes_ = 0, holes_stay_ = 0, changes_ = 0, counted_ = 0, motion_product_ = 0, motion_square_ = 0;
  RawStatistic raw_;
};

}  // namespace

SegmentDeclaration time_segment() {
  SegmentDeclaration s;
  s.name = "time";
  s.group = "time";
  s.unit = "ln of variances and ratios, mm (course), shares";
  s.meaning =
      "whole-frame offset and tilt, their course, likeness of frames 1 to 3 apart, repeats, rows, columns, holes";
  s.fewest_frames = 2;
  s.floor = 0.02;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Time>(context);
  };
  s.stabilise = [](float raw, float, int i, int) {
    // Whole frames that move by less than 0.01 mm (0.02 mm at the image's edge) are nobody's concern.
    if (i < course) return 0.5f * std::log(raw + (i == offset_variance ? 1e-4f : 4e-4f));
    if (i < lag_2 || i == motion_response) return raw;
    if (i == repeated || i == holes_stay || i == flicker) return std::asin(std::sqrt(std::clamp(raw, 0.f, 1.f)));
    return std::log(std::max(raw, 1e-3f));
  };
  return s;
}

}  // namespace binrig
