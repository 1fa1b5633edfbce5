// Runs all segments over the frames of one capture, working out once what they share.
#include <algorithm>
#include <cmath>

#include "compare/statistic.h"
#include "core/error.h"

namespace binrig {
namespace {

/// Robust centre and standard deviation of some 1500 residuals of the image: the outlier limit needs no more, and all
/// pixels would cost more than everything else. The deviation is the larger of what the middle half and what all but a
/// twentieth say: where depth comes in steps, more than half of a frontal plane may read the same.
void robust_spread(const cv::Mat& residual, const cv::Mat& measured, const cv::Mat& interior, double& centre,
                   double& scale) {
  std::vector<float> sample;
  const int count = static_cast<int>(residual.total());
  const float *r = residual.ptr<float>(), *m = measured.ptr<float>(), *i = interior.ptr<float>();
  const int step = std::max(1, count / 1500) | 1;
  for (int p = 0; p < count; p += step)
    if (m[p] * i[p] > 0) sample.push_back(r[p]);
  if (sample.empty()) {
    centre = scale = 0;
    return;
  }
  const auto middle = sample.begin() + sample.size() / 2;
  std::nth_element(sample.begin(), middle, sample.end());
  centre = *middle;
  for (float& s : sample) s = std::abs(s - static_cast<float>(centre));
  std::nth_element(sample.begin(), middle, sample.end());
  scale = 1.4826 * *middle;
  const auto far = sample.begin() + 19 * sample.size() / 20;
  std::nth_element(middle, far, sample.end());
  scale = std::max(scale, *far / 1.96);
}

/// The same depth wherever both have one, which is most of where one has: holes may come and go in a frame that is shown
/// again.
bool equal(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  int both = 0, one = 0;
  for (int v = 0; v < a.rows; ++v) {
    const float *x = a.ptr<float>(v), *y = b.ptr<float>(v);
    for (int u = 0; u < a.cols; ++u) {
      const bool in_a = x[u] > 0, in_b = y[u] > 0;
      if (in_a && in_b && x[u] != y[u]) return false;
      both += in_a && in_b;
      one += in_a || in_b;
    }
  }
  return 2 * both >= one;
}

/// Neighbouring residuals differ by more than rounding to the storage step makes them: the sensor has noise.
bool rough(const cv::Mat& residual, const cv::Mat& used, double depth_scale_mm) {
  std::vector<float> steps;
  const float *r = residual.ptr<float>(), *w = used.ptr<float>();
  for (int p = 0; p + 1 < static_cast<int>(residual.total()); ++p)
    if (w[p] * w[p + 1] > 0) steps.push_back(std::abs(r[p + 1] - r[p]));
  if (steps.empty()) return false;
  const auto middle = steps.begin() + steps.size() / 2;
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle > std::max(1e-3, 0.6 * depth_scale_mm);
}

}  // namespace

struct CaptureStatistics::Impl {
  StatisticContext context;
  std::vector<std::unique_ptr<Statistic>> running;
  std::shared_ptr<const Channels> channels;  // of the regions below
  std::shared_ptr<const CaptureRegions> regions;
  cv::Mat previous_residual, previous_used, previous_depth;
  int number = 0, repeats = 0, regions_number = 0;

  void observe(const Frame& frame, ObservedFrame& seen) {
    const cv::Size size(context.camera.width, context.camera.height);
    const int count = size.area();
    seen.residual_mm.create(size, CV_32F);
    seen.measured.create(size, CV_32F);
    seen.used.create(size, CV_32F);
    const float *z = frame.depth_mm.ptr<float>(), *nominal = channels->depth_mm.ptr<float>();
    const float *counted = regions->counted.ptr<float>(), *interior = regions->interior.ptr<float>();
    float *r = seen.residual_mm.ptr<float>(), *m = seen.measured.ptr<float>(), *used = seen.used.ptr<float>();
#pragma omp simd
    for (int p = 0; p < count; ++p) {
      const float counts = counted[p];
      m[p] = z[p] > 0.f ? counts : 0.f;
      r[p] = m[p] * (z[p] - nominal[p]);
    }
    double depth_mm = 0, measured = 0;
    for (int v = 0; v < size.height; ++v) {
      float row_depth_mm = 0, row_measured = 0;
#pragma omp simd reduction(+ : row_depth_mm, row_measured)
      for (int p = v * size.width; p < (v + 1) * size.width; ++p) {
        row_depth_mm += m[p] * interior[p] * nominal[p];
        row_measured += m[p] * interior[p];
      }
      depth_mm += row_depth_mm, measured += row_measured;
    }
    robust_spread(seen.residual_mm, seen.measured, regions->interior, seen.centre_mm, seen.scale_mm);
    const float centre = static_cast<float>(seen.centre_mm),
                limit = static_cast<float>(outlier_limit_mm(seen, measured > 0 ? depth_mm / measured : 0));
    float inside = 0, kept = 0;
#pragma omp simd reduction(+ : inside, kept)
    for (int p = 0; p < count; ++p) {
      const float here = m[p] * interior[p];
      used[p] = std::abs(r[p] - centre) <= limit ? here : 0.f;
      inside += here;
      kept += used[p];
    }
    seen.interior_pixels = std::lround(inside);
    seen.outliers = std::lround(inside - kept);
  }

  /// Eight standard deviations, and what steps of a quarter of a pixel of disparity or of storage can do to a frame
  /// that hardly shows them.
  double outlier_limit_mm(const ObservedFrame& seen, double distance_mm) const {
    constexpr double coarse_steps_px = 0.25, least_mm = 1;
    const double disparity_mm =
        context.focal_baseline > 0 ? coarse_steps_px * distance_mm * distance_mm / context.focal_baseline : 0;
    return 8 * seen.scale_mm + std::max({least_mm, disparity_mm, 1.5 * context.depth_scale_mm});
  }

  void random_part(ObservedFrame& seen) {
    const int cols = context.camera.width, count = static_cast<int>(seen.used.total());
    const float half = static_cast<float>(std::sqrt(0.5));
    const float *r = seen.residual_mm.ptr<float>(), *used = seen.used.ptr<float>();
    if (context.frames <= 1) {
      seen.random_mm = cv::Mat::zeros(seen.used.size(), CV_32F);
      seen.random_used = cv::Mat::zeros(seen.used.size(), CV_32F);
      seen.spatial = true;
      float *d = seen.random_mm.ptr<float>(), *w = seen.random_used.ptr<float>();
      for (int p = 0; p + 1 < count; ++p) {
        if (p % cols == cols - 1) continue;
        w[p] = used[p] * used[p + 1];
        d[p] = w[p] * half * (r[p + 1] - r[p]);
      }
    } else if (!previous_residual.empty()) {
      seen.random_mm.create(seen.used.size(), CV_32F);
      seen.random_used.create(seen.used.size(), CV_32F);
      const float *before = previous_residual.ptr<float>(), *used_before = previous_used.ptr<float>();
      float *d = seen.random_mm.ptr<float>(), *w = seen.random_used.ptr<float>();
      for (int p = 0; p < count; ++p) {
        w[p] = used[p] * used_before[p];
        d[p] = w[p] * half * (r[p] - before[p]);
      }
    }
  }
};

CaptureStatistics::CaptureStatistics(const StatisticContext& context) : impl_(std::make_unique<Impl>()) {
  impl_->context = context;
  for (const auto& declaration : segments()) {
    const bool possible = context.frames >= declaration.fewest_frames &&
                          !(declaration.planes_only && context.capture.target != TargetKind::plane);
    impl_->running.push_back(possible ? declaration.begin(context) : nullptr);
  }
}

CaptureStatistics::~CaptureStatistics() = default;

void CaptureStatistics::add(const Frame& frame, std::shared_ptr<const Channels> channels,
                            std::shared_ptr<const CaptureRegions> regions) {
  if (frame.depth_mm.empty()) return;
  Impl& self = *impl_;
  const cv::Size size(self.context.camera.width, self.context.camera.height);
  if (frame.depth_mm.size() != size || channels->depth_mm.size() != size)
    throw Error("Capture " + self.context.capture.key() + ": frame and perfect channels differ in size");
  if (!self.regions || self.channels != channels) {
    self.channels = std::move(channels);
    self.regions = regions ? std::move(regions) : std::make_shared<CaptureRegions>(*self.channels, self.context);
    ++self.regions_number;
  }
  if (!self.previous_depth.empty() && equal(frame.depth_mm, self.previous_depth) &&
      rough(self.previous_residual, self.previous_used, self.context.depth_scale_mm)) {
    for (auto& statistic : self.running)
      if (statistic) statistic->repeat();
    ++self.repeats;
    return;
  }
  ObservedFrame seen;
  seen.number = self.number++;
  seen.frame = &frame;
  seen.channels = self.channels.get();
  seen.regions = self.regions.get();
  seen.regions_number = self.regions_number;
  self.observe(frame, seen);
  self.random_part(seen);
  for (auto& statistic : self.running)
    if (statistic) statistic->add(seen);
  self.previous_residual = seen.residual_mm;
  self.previous_used = seen.used;
  self.previous_depth = frame.depth_mm;
}

std::vector<RawStatistic> CaptureStatistics::finish() {
  std::vector<RawStatistic> result;
  for (auto& statistic : impl_->running) {
    result.push_back(statistic ? statistic->finish() : RawStatistic{});
    if (impl_->repeats > 0)
      for (float& weight : result.back().weight) weight *= 1 + static_cast<float>(impl_->repeats) / impl_->number;
    result.back().spatial = impl_->context.frames <= 1;
  }
  return result;
}

float stabilised_share(float share, float count) {
  return std::asin(std::sqrt((std::clamp(share, 0.f, 1.f) * count + 0.375f) / (count + 0.75f)));
}

std::vector<float> SegmentDeclaration::transform(const RawStatistic& raw, const RawStatistic& reference) const {
  if (raw.value.size() != reference.value.size()) throw Error("Segment " + name + " differs in size");
  const int n = static_cast<int>(raw.value.size());
  std::vector<float> result(n, 0.f);
  for (int i = 0; i < n; ++i)
    if (raw.weight[i] > 0 && reference.weight[i] > 0)
      result[i] =
          stabilise(raw.value[i], raw.weight[i], i, n) - stabilise(reference.value[i], reference.weight[i], i, n);
  return result;
}

const std::vector<SegmentDeclaration>& segments() {
  static const std::vector<SegmentDeclaration> all{bias_segment(),  noise_segment(),    dropout_segment(),
                                                   edges_segment(), spectrum_segment(), shape_segment(),
                                                   time_segment(),  comb_segment(),     fixed_pattern_segment()};
  return all;
}

const SegmentDeclaration& segment(const std::string& name) {
  std::vector<std::string> names;
  for (const auto& s : segments()) {
    if (s.name == name) return s;
    names.push_back(s.name);
  }
  const std::string near = nearest_word(name, names);
  throw Error("There is no statistic \"" + name + "\"" + (near.empty() ? "" : " (did you mean " + near + "?)"));
}

ChannelSet statistics_channels() {
  return Channel::depth | Channel::cos_incidence | Channel::projector_gap | Channel::edge_distance;
}

}  // namespace binrig
