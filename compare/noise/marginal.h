// How the values of the noise are distributed, whatever their place.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

namespace binrig {

struct MarginalSummary {
  double pixels = 0;  ///< values counted; neighbours are not independent
  double mean_mm = 0, sigma_mm = 0;
  double robust_sigma_mm = 0;                     ///< 1.4826 times the median absolute deviation from the median
  double skewness = 0, excess_kurtosis = 0;       ///< 0 and 0 for Gaussian noise
  double beyond_3_sigma = 0, beyond_4_sigma = 0;  ///< shares; 0.0027 and 0.000063 for Gaussian noise
  std::vector<double> edges_mm, counts;  ///< histogram of 240 bins over -6 .. 6 sigma of the first frame, ends open
};

/// Streaming: first the scale, then frame after frame.
class Marginal {
 public:
  /// `scale_mm`: about the standard deviation; sets the histogram's bins. Throws Error unless positive.
  explicit Marginal(double scale_mm);
  void add(const cv::Mat& residual_mm, const cv::Mat& valid);
  MarginalSummary finish() const;

 private:
  double scale_;
  std::vector<double> counts_;  // fine bins of scale / 20; first and last are open
  double n_ = 0, s1_ = 0, s2_ = 0, s3_ = 0, s4_ = 0;
};

/// Values from frame after frame, at most `most`: when it is full, every other value goes and only every other frame
/// (then every fourth ...) is taken from there on, so that what is kept stays evenly spread in time.
class SampleStore {
 public:
  explicit SampleStore(std::size_t most = 400000) : most_(most) {}
  void add(const cv::Mat& residual_mm, const cv::Mat& valid, int spacing);
  const std::vector<float>& values() const { return values_; }

 private:
  std::size_t most_;
  int stride_ = 1, frame_ = 0;
  std::vector<float> values_;
  std::vector<std::size_t> frame_begin_;
};

}  // namespace binrig
