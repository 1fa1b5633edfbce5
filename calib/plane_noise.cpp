#include "calib/plane_noise.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/polynomial_basis.h"
#include "core/error.h"

namespace binrig {

namespace {

// Greatest common divisor of all stored values, in steps of the file's scale.
class CommonStep {
 public:
  void add(const cv::Mat& depth, double scale) {
    if (scale <= 0 || divisor_ == 1) return;
    for (int row = 0; row < depth.rows; ++row)
      for (int col = 0; col < depth.cols; ++col) {
        const auto steps = static_cast<std::int64_t>(std::llround(depth.at<float>(row, col) / scale));
        if (steps > 0) divisor_ = std::gcd(divisor_, steps);
      }
  }
  double step(double scale) const { return divisor_ > 0 ? divisor_ * scale : scale; }

 private:
  std::int64_t divisor_ = 0;
};

struct Residual {
  cv::Mat mm, valid;
};

// Measured minus the first frame's plane, with what the plane moved since (offset and tilt) taken out and gross
// outliers beyond 8 sigma left out, as in the first frame.
Residual residual_of(const Frame& frame, const cv::Mat& plane_mm, const cv::Mat& region, double sigma) {
  Residual result;
  cv::subtract(frame.depth_mm, plane_mm, result.mm);
  result.valid = (frame.depth_mm > 0) & (region > 0) & (plane_mm > 0);
  const double generous = std::max(10.0, 40 * sigma);
  result.valid &= cv::abs(result.mm) < generous;
  for (int round = 0; round < 2; ++round) {
    result.mm = PolynomialBasis(result.valid, 1).remainder(result.mm);
    if (round == 0) result.valid &= cv::abs(result.mm) < std::max(8 * sigma, 1e-6);
  }
  result.mm.setTo(0, ~result.valid);
  return result;
}

}  // namespace

FirstLook look_at(const std::string& key, const std::string& name, const Frame& first, int frames,
                  const cv::Mat& region, const PlaneFitOptions& options) {
  FirstLook look;
  look.key = key;
  look.name = name;
  look.frames = frames;
  look.camera = first.camera;
  look.depth_scale_mm = first.depth_scale_mm;
  look.region_given = !region.empty();
  try {
    look.plane = fit_plane(first.depth_mm, PixelRays(first.camera), region, options);
  } catch (const Error& error) {
    throw Error(key + ": " + error.what());
  }
  const PixelRays rays(first.camera);
  double sum = 0;
  for (int row = 0; row < rays.x.rows; ++row)
    for (int col = 0; col < rays.x.cols; ++col) {
      if (look.plane.valid.at<std::uint8_t>(row, col) == 0) continue;
      const Vector3 ray = Vector3(rays.x.at<double>(row, col), rays.y.at<double>(row, col), 1).normalized();
      const double theta = std::min(1.4, std::acos(std::min(1.0, std::abs(ray.dot(look.plane.normal)))));
      sum += std::pow(theta / (std::numbers::pi / 2 - theta), 2);
    }
  look.incidence_term = sum / look.plane.pixels;
  look.order_powers = order_powers(look.plane.residual_mm, look.plane.valid);
  return look;
}

CaptureNoise measure_noise(const FirstLook& look, const FrameStream& frames, bool region_masks,
                           const PlaneNoiseOptions& options) {
  CaptureNoise noise;
  noise.look = look;
  const cv::Rect box = cv::boundingRect(look.plane.region);
  const int max_lag = options.max_lag_px > 0 ? options.max_lag_px
                                             : choose_max_lag(static_cast<double>(look.plane.pixels) * look.frames,
                                                              std::min(box.width, box.height));
  const cv::Mat plane_mm = look.plane.perfect_depth(PixelRays(look.camera));
  // The fit's sigma is robust: correlated waves and rounding make tails that are not outliers.
  const double sigma = std::max(look.plane.sigma_mm, look.plane.rms_z_mm);

  SpectrumEstimator single(max_lag, options.drop_order), differences(max_lag, 1);
  CommonStep common;
  const int cell = std::max(16, std::min(box.width, box.height) / 12);
  CellVariance single_cells(box.size(), cell), difference_cells(box.size(), cell);
  const int single_step = std::max(1, look.frames / std::max(1, options.single_frames));
  Residual previous, before;
  double one_apart = 0, one_count = 0, two_apart = 0, two_count = 0;
  int repeated = 0;
  frames([&](const Frame& frame, int number) {
    if (frame.depth_mm.empty() || frame.status == FrameStatus::timeout) return;
    try {
      if (!(frame.camera == look.camera)) throw Error("its camera differs from that of the first frame");
      const cv::Mat marked = marked_region(frame, region_masks && look.region_given);
      Residual now = residual_of(frame, plane_mm, marked.empty() ? look.plane.region : marked, sigma);
      common.add(frame.depth_mm, frame.depth_scale_mm);
      ++noise.frames_used;
      if (number % single_step == 0) {
        single.add(now.mm, now.valid);
        single_cells.add(PolynomialBasis(now.valid, options.drop_order).remainder(now.mm)(box), now.valid(box));
      }
      const auto mean_square = [](const Residual& a, const Residual& b, double& sum, double& count) {
        const cv::Mat both = a.valid & b.valid;
        cv::Mat difference;
        cv::subtract(a.mm, b.mm, difference, both);
        sum += cv::norm(difference, cv::NORM_L2SQR, both);
        count += cv::countNonZero(both);
      };
      if (!previous.mm.empty()) {
        const cv::Mat both = now.valid & previous.valid;
        cv::Mat difference = cv::Mat::zeros(now.mm.size(), CV_32F);
        cv::subtract(now.mm, previous.mm, difference, both);
        // A frame that the device sent twice says nothing about noise.
        if (cv::norm(difference, cv::NORM_INF, both) < 1e-3) {
          ++repeated;
          return;
        }
        differences.add(difference, both, 0.5);
        difference_cells.add(difference(box), both(box));
        mean_square(now, previous, one_apart, one_count);
        if (!before.mm.empty()) mean_square(now, before, two_apart, two_count);
      }
      before = previous;
      previous = now;
    } catch (const Error& error) {
      throw Error(fmt::format("{}, frame {}: {}", look.key, number, error.what()));
    }
  });
  if (noise.frames_used == 0) throw Error(look.key + ": no frame with depth");

  noise.single = single.finish();
  noise.repeated_share = static_cast<double>(repeated) / noise.frames_used;
  if (differences.frames() > 0) {
    // Successive differences share a frame: their periodograms correlate by a quarter.
    const double n = differences.frames();
    noise.temporal = differences.finish(1 + 0.5 * (n - 1) / n);
    noise.fixed_variance_mm2 = noise.single.variance_mm2() - noise.temporal->variance_mm2();
  }
  if (two_count > 0 && one_apart > 0) noise.memory = (two_apart / two_count) / (one_apart / one_count) - 1;
  noise.stationarity = noise.temporal ? difference_cells.finish(noise.temporal->covariance, 0, plane_mm(box))
                                      : single_cells.finish(noise.single.covariance, 0, plane_mm(box));
  noise.step_mm = common.step(look.depth_scale_mm);

  const double deviation = noise.noise().sigma_mm();
  if (!noise.temporal)
    noise.remarks.push_back(
        "a single frame: shape, fixed pattern and noise cannot be told apart, so this is an upper "
        "bound for the noise");
  if (deviation < 0.5 * noise.step_mm)
    noise.remarks.push_back(
        fmt::format("the noise ({:.3g} mm) is below half a storage step ({:.3g} mm): rounding is no "
                    "white noise then, and the spectrum's shape is doubtful",
                    deviation, noise.step_mm));
  if (noise.memory && *noise.memory > 0.05)
    noise.remarks.push_back(
        fmt::format("frames two apart differ by {:.0f} % more variance than successive ones: the "
                    "noise has a memory, and differences of frames miss a part of it",
                    100 * *noise.memory));
  if (repeated > 0)
    noise.remarks.push_back(fmt::format("{} of {} frames repeat their predecessor", repeated, noise.frames_used));
  return noise;
}

}  // namespace binrig
