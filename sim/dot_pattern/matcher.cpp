#include "sim/dot_pattern/matcher.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/frame.h"
#include "core/parallel.h"

namespace binrig::dot_pattern {
namespace {

constexpr float untried = -1.5f;  // less alike than any two windows can be

// Sum over the window centred on each pixel; 0 where the window leaves the image.
cv::Mat window_sum(const cv::Mat& image, int radius) {
  cv::Mat integral;
  cv::integral(image, integral, CV_64F);
  cv::Mat sum = cv::Mat::zeros(image.size(), CV_64F);
  for (int v = radius; v < image.rows - radius; ++v) {
    const double* top = integral.ptr<double>(v - radius);
    const double* bottom = integral.ptr<double>(v + radius + 1);
    double* out = sum.ptr<double>(v);
    for (int u = radius; u < image.cols - radius; ++u) {
      out[u] = bottom[u + radius + 1] - bottom[u - radius] - top[u + radius + 1] + top[u - radius];
    }
  }
  return sum;
}

struct WindowStatistics {
  cv::Mat sum, inverse_norm;  // CV_32F; inverse_norm = 1 / sqrt(sum of squared deviations), 0 where there are none
};

WindowStatistics window_statistics(const cv::Mat& image, int radius) {
  cv::Mat values;
  image.convertTo(values, CV_64F);
  const cv::Mat sum = window_sum(values, radius), squares = window_sum(values.mul(values), radius);
  const double n = (2 * radius + 1) * (2 * radius + 1);
  WindowStatistics result{cv::Mat(image.size(), CV_32F), cv::Mat(image.size(), CV_32F)};
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const double s = sum.at<double>(v, u), deviation = squares.at<double>(v, u) - s * s / n;
      result.sum.at<float>(v, u) = static_cast<float>(s);
      result.inverse_norm.at<float>(v, u) = deviation > 0.5 ? static_cast<float>(1 / std::sqrt(deviation)) : 0.f;
    }
  }
  return result;
}

class Zncc {
 public:
  using Pixel = std::int16_t;
  static constexpr int neighbourhood = 0;
  Zncc(const cv::Mat& left, const cv::Mat& right, int radius) : n_((2 * radius + 1) * (2 * radius + 1)) {
    // Removing the means first keeps the sums small; the likeness does not depend on it.
    left.convertTo(left_, CV_16S, 1, -std::round(cv::mean(left)[0]));
    right.convertTo(right_, CV_16S, 1, -std::round(cv::mean(right)[0]));
    left_statistics_ = window_statistics(left_, radius);
    right_statistics_ = window_statistics(right_, radius);
    right_statistics_.sum *= 1.0 / n_;
  }
  const Pixel* left(int v) const { return left_.ptr<Pixel>(v); }
  const Pixel* right(int v) const { return right_.ptr<Pixel>(v); }
  static std::int32_t pair(Pixel l, Pixel r) { return static_cast<std::int32_t>(l) * r; }
  void likeness(int v, int first, int last, int shift, const std::int32_t* sums, float* out) const {
    const float* sl = left_statistics_.sum.ptr<float>(v);
    const float* nl = left_statistics_.inverse_norm.ptr<float>(v);
    const float* mr = right_statistics_.sum.ptr<float>(v) + shift;
    const float* nr = right_statistics_.inverse_norm.ptr<float>(v) + shift;
    for (int u = first; u < last; ++u) out[u] = (static_cast<float>(sums[u]) - sl[u] * mr[u]) * (nl[u] * nr[u]);
  }

 private:
  cv::Mat left_, right_;
  WindowStatistics left_statistics_, right_statistics_;
  double n_;
};

class Census {
 public:
  using Pixel = std::uint64_t;
  static constexpr int neighbourhood = 3;
  Census(const cv::Mat& left, const cv::Mat& right, int radius)
      : cols_left_(left.cols), cols_right_(right.cols), left_(transform(left)), right_(transform(right)) {
    scale_ = -2.f / (48.f * (2 * radius + 1) * (2 * radius + 1));
  }
  const Pixel* left(int v) const { return left_.data() + static_cast<std::size_t>(v) * cols_left_; }
  const Pixel* right(int v) const { return right_.data() + static_cast<std::size_t>(v) * cols_right_; }
  static std::int32_t pair(Pixel l, Pixel r) {
    Pixel x = l ^ r;  // bit count by halves: compilers turn this into vector code on any machine
    x -= (x >> 1) & 0x5555555555555555ull;
    x = (x & 0x3333333333333333ull) + ((x >> 2) & 0x3333333333333333ull);
    x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0full;
    x += x >> 8;
    x += x >> 16;
    x += x >> 32;
    return static_cast<std::int32_t>(x & 0x7f);
  }
  void likeness(int, int first, int last, int, const std::int32_t* sums, float* out) const {
    for (int u = first; u < last; ++u) out[u] = 1.f + scale_ * static_cast<float>(sums[u]);
  }

 private:
  static std::vector<Pixel> transform(const cv::Mat& image) {
    std::vector<Pixel> bits(image.total(), 0);
    parallel_for(std::max(0, image.rows - 6), [&](int i) {
      const int v = i + 3;
      for (int u = 3; u < image.cols - 3; ++u) {
        const std::uint16_t centre = image.at<std::uint16_t>(v, u);
        Pixel word = 0;
        for (int dv = -3; dv <= 3; ++dv) {
          const std::uint16_t* row = image.ptr<std::uint16_t>(v + dv) + u;
          for (int du = -3; du <= 3; ++du) {
            if (dv || du) word = (word << 1) | (row[du] < centre ? 1u : 0u);
          }
        }
        bits[static_cast<std::size_t>(v) * image.cols + u] = word;
      }
    });
    return bits;
  }
  int cols_left_, cols_right_;
  std::vector<Pixel> left_, right_;
  float scale_ = 0;
};

// The right image laid out so that left pixel u at disparity lowest + k is column u + (count - 1 - k).
struct PaddedRight {
  cv::Mat image;
  int first_inside = 0, end_inside = 0;  // columns that the right image really has
};

PaddedRight pad_right(const cv::Mat& right, int right_origin, int left_cols, const MatchSettings& s) {
  const int count = s.highest_px - s.lowest_px + 1;
  PaddedRight result;
  result.image = cv::Mat::zeros(right.rows, left_cols + count - 1, right.type());
  const int offset = right_origin + s.highest_px;  // column of the right image's first pixel
  result.first_inside = std::clamp(offset, 0, result.image.cols);
  result.end_inside = std::clamp(offset + right.cols, 0, result.image.cols);
  const int width = result.end_inside - result.first_inside;
  if (width > 0) {
    right(cv::Rect(result.first_inside - offset, 0, width, right.rows))
        .copyTo(result.image(cv::Rect(result.first_inside, 0, width, right.rows)));
  }
  return result;
}

// Work of one thread on a band of rows.
template <typename Picture>
class Band {
 public:
  Band(const Picture& picture, const PaddedRight& right, int cols, const MatchSettings& s)
      : picture_(picture),
        s_(s),
        cols_(cols),
        count_(s.highest_px - s.lowest_px + 1),
        radius_(s.window_px / 2),
        margin_(radius_ + Picture::neighbourhood),
        first_right_(right.first_inside + margin_),
        end_right_(right.end_inside - margin_),
        columns_(static_cast<std::size_t>(count_) * cols),
        likeness_(static_cast<std::size_t>(count_) * cols),
        sums_(cols),
        best_(cols),
        second_(cols),
        arg_(cols),
        best_right_(cols + count_),
        arg_right_(cols + count_) {}

  void run(int first_row, int end_row, Matches& out) {
    std::fill(columns_.begin(), columns_.end(), 0);
    for (int v = first_row - radius_; v < first_row + radius_; ++v) add_row(v, +1);
    for (int v = first_row; v < end_row; ++v) {
      add_row(v + radius_, +1);
      likeness_of_row(v);
      decide(v, out);
      add_row(v - radius_, -1);
    }
  }

 private:
  void add_row(int v, int sign) {
    const auto* left = picture_.left(v);
    for (int k = 0; k < count_; ++k) {
      const auto* right = picture_.right(v) + (count_ - 1 - k);
      std::int32_t* column = &columns_[static_cast<std::size_t>(k) * cols_];
      for (int u = 0; u < cols_; ++u) column[u] += sign * Picture::pair(left[u], right[u]);
    }
  }

  void likeness_of_row(int v) {
    for (int k = 0; k < count_; ++k) {
      const int shift = count_ - 1 - k;
      const std::int32_t* column = &columns_[static_cast<std::size_t>(k) * cols_];
      float* out = &likeness_[static_cast<std::size_t>(k) * cols_];
      const int first = std::clamp(first_right_ - shift, margin_, cols_ - margin_);
      const int last = std::clamp(end_right_ - shift, first, cols_ - margin_);
      std::fill(out, out + cols_, untried);
      if (first == last) continue;
      std::int32_t sum = 0;
      for (int u = first - radius_; u < first + radius_; ++u) sum += column[u];
      for (int u = first; u < last; ++u) {
        sum += column[u + radius_];
        sums_[u] = sum;
        sum -= column[u - radius_];
      }
      picture_.likeness(v, first, last, shift, sums_.data(), out);
    }
  }

  void decide(int v, Matches& out) {
    std::fill(best_.begin(), best_.end(), -2.f);
    std::fill(second_.begin(), second_.end(), -2.f);
    std::fill(best_right_.begin(), best_right_.end(), -2.f);
    std::fill(arg_.begin(), arg_.end(), 0);
    for (int k = 0; k < count_; ++k) {
      const float* row = &likeness_[static_cast<std::size_t>(k) * cols_];
      float* best = best_.data();
      int* arg = arg_.data();
      float* best_right = best_right_.data() + (count_ - 1 - k);
      int* arg_right = arg_right_.data() + (count_ - 1 - k);
      for (int u = 0; u < cols_; ++u) {
        arg[u] = row[u] > best[u] ? k : arg[u];
        best[u] = std::max(best[u], row[u]);
      }
      for (int u = 0; u < cols_; ++u) {
        arg_right[u] = row[u] > best_right[u] ? k : arg_right[u];
        best_right[u] = std::max(best_right[u], row[u]);
      }
    }
    for (int k = 0; k < count_; ++k) {
      const float* row = &likeness_[static_cast<std::size_t>(k) * cols_];
      float* second = second_.data();
      const int* arg = arg_.data();
      for (int u = 0; u < cols_; ++u) {
        const bool elsewhere = std::abs(k - arg[u]) > 1;
        second[u] = std::max(second[u], elsewhere ? row[u] : -2.f);
      }
    }
    float* disparity = out.disparity_px.ptr<float>(v);
    std::uint8_t* reason = out.reason.ptr<std::uint8_t>(v);
    for (int u = margin_; u < cols_ - margin_; ++u) {
      const int k = arg_[u];
      const int partner = u + count_ - 1 - k;
      Reason why = Reason::measured;
      if (u < first_right_ || u + count_ - 1 >= end_right_) why = Reason::border;  // not all disparities can be tried
      if (best_[u] < s_.min_correlation || best_[u] - second_[u] < s_.uniqueness ||
          std::abs(arg_right_[partner] - k) > s_.max_left_right_px) {
        if (why == Reason::measured) why = Reason::no_match;
      } else if (k == 0 || k == count_ - 1) {
        why = Reason::out_of_range;
      } else {
        const float below = likeness_[static_cast<std::size_t>(k - 1) * cols_ + u], here = best_[u],
                    above = likeness_[static_cast<std::size_t>(k + 1) * cols_ + u];
        why = below > untried && above > untried ? Reason::measured : Reason::border;
        const float curvature = below - 2 * here + above;
        const float fraction = curvature < 0 ? 0.5f * (below - above) / curvature : 0.f;
        disparity[u] = static_cast<float>(s_.lowest_px + k) + fraction;
      }
      reason[u] = static_cast<std::uint8_t>(why);
    }
  }

  const Picture& picture_;
  const MatchSettings& s_;
  int cols_, count_, radius_, margin_, first_right_, end_right_;
  std::vector<std::int32_t> columns_;  // per disparity and column: the pair costs summed over the window's rows
  std::vector<float> likeness_;        // per disparity and column, of the row at work
  std::vector<std::int32_t> sums_;
  std::vector<float> best_, second_;
  std::vector<int> arg_;
  std::vector<float> best_right_;
  std::vector<int> arg_right_;
};

template <typename Picture>
void match_with(const cv::Mat& left, const PaddedRight& right, const MatchSettings& s, Matches& out) {
  const int radius = s.window_px / 2;
  const Picture picture(left, right.image, radius);
  const int margin = radius + Picture::neighbourhood;
  const int rows = left.rows - 2 * margin;
  const int bands = std::clamp(rows / (4 * s.window_px), 1, 2 * jobs());
  parallel_for(bands, [&](int i) {
    Band<Picture>(picture, right, left.cols, s).run(margin + rows * i / bands, margin + rows * (i + 1) / bands, out);
  });
}

// Too dark and too bright are seen in the image itself: a flat window is never a match, and where a match failed in a
// full one, fullness is why.
void judge_signal(const cv::Mat& left, const MatchSettings& s, Matches& out) {
  const int radius = s.window_px / 2;
  const double n = s.window_px * s.window_px;
  cv::Mat values, full;
  left.convertTo(values, CV_64F);
  cv::Mat(left >= s.full_scale).convertTo(full, CV_64F, 1.0 / 255);
  const cv::Mat sum = window_sum(values, radius), squares = window_sum(values.mul(values), radius),
                count = window_sum(full, radius);
  for (int v = radius; v < left.rows - radius; ++v) {
    for (int u = radius; u < left.cols - radius; ++u) {
      auto& reason = out.reason.at<std::uint8_t>(v, u);
      const double mean = sum.at<double>(v, u) / n;
      const double deviation = std::sqrt(std::max(0.0, squares.at<double>(v, u) / n - mean * mean));
      if (reason == static_cast<std::uint8_t>(Reason::border)) continue;
      if (reason != 0 && count.at<double>(v, u) > s.saturated_share * n) {
        reason = static_cast<std::uint8_t>(Reason::saturated);
      } else if (deviation < s.min_contrast * s.full_scale) {
        reason = static_cast<std::uint8_t>(Reason::low_signal);
      }
    }
  }
}

// Connected islands of nearly equal disparity that are too small to be a surface.
void remove_speckles(const MatchSettings& s, Matches& out) {
  const int rows = out.reason.rows, cols = out.reason.cols;
  cv::Mat seen = cv::Mat::zeros(rows, cols, CV_8U);
  std::vector<cv::Point> island;
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      if (out.reason.at<std::uint8_t>(row, col) != 0 || seen.at<std::uint8_t>(row, col)) continue;
      island.assign(1, cv::Point(col, row));
      seen.at<std::uint8_t>(row, col) = 1;
      for (std::size_t i = 0; i < island.size(); ++i) {
        const cv::Point p = island[i];
        const float here = out.disparity_px.at<float>(p);
        for (const cv::Point step : {cv::Point(1, 0), cv::Point(-1, 0), cv::Point(0, 1), cv::Point(0, -1)}) {
          const cv::Point q = p + step;
          if (q.x < 0 || q.y < 0 || q.x >= cols || q.y >= rows) continue;
          if (out.reason.at<std::uint8_t>(q) != 0 || seen.at<std::uint8_t>(q)) continue;
          if (std::abs(out.disparity_px.at<float>(q) - here) > s.speckle_step_px) continue;
          seen.at<std::uint8_t>(q) = 1;
          island.push_back(q);
        }
      }
      if (static_cast<int>(island.size()) >= s.speckle_size_px) continue;
      for (const cv::Point& p : island) out.reason.at<std::uint8_t>(p) = static_cast<std::uint8_t>(Reason::no_match);
    }
  }
}

void check_images(const cv::Mat& left, const cv::Mat& right, const MatchSettings& s) {
  Violations violations;
  if (left.type() != CV_16U || right.type() != CV_16U) violations.add("matcher", "images", "must be CV_16U");
  if (left.rows != right.rows) violations.add("matcher", "images", "must have as many rows each");
  if (s.window_px < 3 || s.window_px % 2 == 0) violations.add("matcher", "window", "must be odd and at least 3");
  if (s.highest_px - s.lowest_px < 2) violations.add("matcher", "disparities", "must be at least three");
  if (std::min(left.rows, left.cols) <= s.window_px + 6) {
    violations.add("matcher", "images", "are smaller than the window and its surroundings");
  }
  violations.throw_if_any("the images cannot be matched");
}

}  // namespace

Matches match_blocks(const cv::Mat& left, const cv::Mat& right, int right_origin_px, const MatchSettings& s) {
  check_images(left, right, s);
  Matches out{cv::Mat::zeros(left.size(), CV_32F),
              cv::Mat(left.size(), CV_8U, cv::Scalar(static_cast<int>(Reason::border)))};
  const PaddedRight padded = pad_right(right, right_origin_px, left.cols, s);
  if (s.cost == Cost::zncc) {
    match_with<Zncc>(left, padded, s, out);
  } else {
    match_with<Census>(left, padded, s, out);
  }
  judge_signal(left, s, out);
  remove_speckles(s, out);
  if (s.disparity_step_px > 0) {
    const float step = static_cast<float>(s.disparity_step_px);
    for (int v = 0; v < left.rows; ++v) {
      float* disparity = out.disparity_px.ptr<float>(v);
      for (int u = 0; u < left.cols; ++u) disparity[u] = std::round(disparity[u] / step) * step;
    }
  }
  return out;
}

}  // namespace binrig::dot_pattern
