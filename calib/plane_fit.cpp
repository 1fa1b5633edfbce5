#include "calib/plane_fit.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/ray_table.h"
#include "core/random.h"

namespace binrig {

namespace {

// In all of this file a plane is q = (a, b, c): 1/z = a x + b y + c on the ray (x, y, 1).
using Plane = Eigen::Vector3d;

struct Sample {
  double x, y, z;
};

double inverse_depth(const Plane& plane, double x, double y) { return plane[0] * x + plane[1] * y + plane[2]; }
// Measured minus plane along z, to first order in the residual; exact enough where the residual is far below z, and
// finite everywhere.
double residual_along_z(const Plane& plane, const Sample& s) {
  return s.z * (inverse_depth(plane, s.x, s.y) * s.z - 1);
}

double median(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void check_depth(const cv::Mat& depth, const PixelRays& rays, const cv::Mat& mask) {
  if (depth.type() != CV_32F || depth.rows != rays.camera.height || depth.cols != rays.camera.width)
    throw Error(fmt::format("the plane fit wants a float depth image of {} x {} pixels, not {} x {}", rays.camera.width,
                            rays.camera.height, depth.cols, depth.rows));
  if (!mask.empty() && (mask.type() != CV_8U || mask.size() != depth.size()))
    throw Error("the mask of a plane fit must be an 8-bit image of the depth image's size");
  for (int row = 0; row < depth.rows; ++row)
    for (int col = 0; col < depth.cols; ++col) {
      const float z = depth.at<float>(row, col);
      if (!std::isfinite(z) || z < 0)
        throw Error(fmt::format("the depth at row {}, column {} is {}; invalid pixels are 0", row, col, z));
    }
}

std::vector<Sample> gather(const cv::Mat& depth, const PixelRays& rays, const cv::Mat& mask, std::size_t at_most) {
  std::vector<Sample> samples;
  for (int row = 0; row < depth.rows; ++row) {
    const float* z = depth.ptr<float>(row);
    const std::uint8_t* inside = mask.empty() ? nullptr : mask.ptr<std::uint8_t>(row);
    for (int col = 0; col < depth.cols; ++col)
      if (z[col] > 0 && (inside == nullptr || inside[col] != 0))
        samples.push_back({rays.x.at<double>(row, col), rays.y.at<double>(row, col), z[col]});
  }
  if (samples.size() <= at_most) return samples;
  std::vector<Sample> fewer(at_most);
  for (std::size_t i = 0; i < at_most; ++i) fewer[i] = samples[i * samples.size() / at_most];
  return fewer;
}

bool through_three(const Sample& p, const Sample& q, const Sample& r, Plane& plane) {
  Eigen::Matrix3d rows;
  rows << p.x, p.y, 1, q.x, q.y, 1, r.x, r.y, 1;
  if (std::abs(rows.determinant()) < 1e-9) return false;
  plane = rows.inverse() * Eigen::Vector3d(1 / p.z, 1 / q.z, 1 / r.z);
  return plane.allFinite();
}

// Noise along z as the data themselves show it: half the pixels' second differences over 4 px rows. Correlated noise
// makes it too small, so callers put a floor under it.
double local_noise(const cv::Mat& depth, const cv::Mat& mask) {
  std::vector<double> second;
  constexpr int lag = 4;
  for (int row = 0; row < depth.rows; row += 2)
    for (int col = lag; col + lag < depth.cols; col += 3) {
      if (!mask.empty() && mask.at<std::uint8_t>(row, col) == 0) continue;
      const float a = depth.at<float>(row, col - lag), b = depth.at<float>(row, col),
                  c = depth.at<float>(row, col + lag);
      if (a > 0 && b > 0 && c > 0) second.push_back(std::abs(a - 2 * b + c));
    }
  return 1.4826 * median(second) / std::sqrt(6.0);
}

struct Weighted {
  Plane plane;
  double sigma_mm = 0;  ///< at mean_z
  double mean_z = 0;
  Eigen::Matrix3d unscaled_covariance;
};

// Tukey-weighted least squares on inverse depth. Noise sigma ~ z^p means a standard deviation of z^(p-2) in 1/z.
Weighted refine(const std::vector<Sample>& samples, Plane plane, double exponent, double first_sigma) {
  Weighted result;
  for (const auto& s : samples) result.mean_z += s.z / samples.size();
  double sigma = first_sigma;
  std::vector<double> sizes(samples.size()), expected(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) expected[i] = std::pow(samples[i].z / result.mean_z, exponent);
  for (int round = 0; round < 30; ++round) {
    Eigen::Matrix3d normal_matrix = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const Sample& s = samples[i];
      const double standardised = residual_along_z(plane, s) / expected[i] / (4.685 * sigma);
      if (std::abs(standardised) >= 1) continue;
      const double tukey = 1 - standardised * standardised;
      const double sigma_inverse = expected[i] * result.mean_z * result.mean_z / (s.z * s.z);
      const double weight = tukey * tukey / (sigma_inverse * sigma_inverse);
      const Eigen::Vector3d row(s.x, s.y, 1);
      normal_matrix += weight * row * row.transpose();
      right += weight / s.z * row;
    }
    const Eigen::LDLT<Eigen::Matrix3d> solver(normal_matrix);
    if (solver.info() != Eigen::Success || !(solver.vectorD().minCoeff() > 0)) break;
    const Plane next = solver.solve(right);
    result.unscaled_covariance = normal_matrix.inverse();
    const double change = (next - plane).cwiseAbs().maxCoeff() * result.mean_z * result.mean_z;
    plane = next;
    for (std::size_t i = 0; i < samples.size(); ++i)
      sizes[i] = std::abs(residual_along_z(plane, samples[i])) / expected[i];
    // The scale's last digits would keep the weights moving for ever; quantised depth can have a MAD of 0.
    const double next_sigma = std::max(1.4826 * median(sizes), 1e-6 * result.mean_z);
    const bool settled = change < 1e-5 * sigma && std::abs(next_sigma - sigma) < 1e-3 * sigma;
    sigma = next_sigma;
    if (settled) break;
  }
  result.plane = plane;
  result.sigma_mm = sigma;
  return result;
}

// Best of many planes through three samples, by the number of samples within the threshold (mm at mean_z, growing with
// z^2). With `local`, the three are neighbours in the list's order of rows, so that a small flat part is hit, too.
Plane ransac(const std::vector<Sample>& samples, double threshold, const RandomStream& random, bool local, int rounds,
             double& best_share) {
  double mean_z = 0;
  for (const auto& s : samples) mean_z += s.z / samples.size();
  Plane best(0, 0, 1 / mean_z);
  best_share = 0;
  const std::size_t n = samples.size();
  for (int round = 0; round < rounds; ++round) {
    const std::size_t first = static_cast<std::size_t>(random.uniform(3 * round) * n);
    const auto other = [&](int k) {
      if (!local) return static_cast<std::size_t>(random.uniform(3 * round + k) * n);
      const double span = std::max(30.0, n * (round % 3 == 0 ? 0.1 : round % 3 == 1 ? 0.3 : 1.0));
      const double at = first + (random.uniform(3 * round + k) - 0.5) * span;
      return static_cast<std::size_t>(std::clamp(at, 0.0, n - 1.0));
    };
    Plane plane;
    if (!through_three(samples[first], samples[other(1)], samples[other(2)], plane)) continue;
    std::size_t inside = 0;
    for (const auto& s : samples) {
      const double scale = s.z / mean_z;
      inside += std::abs(residual_along_z(plane, s)) < threshold * scale * scale;
    }
    const double share = static_cast<double>(inside) / n;
    if (share > best_share) best_share = share, best = plane;
  }
  return best;
}

double first_threshold(const cv::Mat& depth, const cv::Mat& mask, double mean_z) {
  // Real planes wave by some per mille of their distance; that is no reason to lose them. Beyond some per cent anything
  // would be a plane.
  return std::clamp(4 * local_noise(depth, mask), 0.004 * mean_z, 0.03 * mean_z);
}

Vector3 normal_of(const Plane& plane) { return -plane.normalized(); }

double incidence(const Plane& plane, double x, double y) {
  const Vector3 ray = Vector3(x, y, 1).normalized();
  return std::acos(std::clamp(std::abs(ray.dot(normal_of(plane))), 0.0, 1.0));
}

void largest_component(cv::Mat& mask) {
  cv::Mat labels, stats, centroids;
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centroids, 4);
  int best = 0, area = 0;
  for (int i = 1; i < count; ++i)
    if (stats.at<int>(i, cv::CC_STAT_AREA) > area) area = stats.at<int>(i, cv::CC_STAT_AREA), best = i;
  mask = best == 0 ? cv::Mat::zeros(mask.size(), CV_8U) : cv::Mat(labels == best);
}

// Where the mean residual over 9 x 9 pixels stays within the threshold: single outliers and holes do not tear it, edges
// and bulges do.
cv::Mat flat_part(const cv::Mat& depth, const PixelRays& rays, const Plane& plane, double threshold, double mean_z) {
  cv::Mat sum = cv::Mat::zeros(depth.size(), CV_32F), count = cv::Mat::zeros(depth.size(), CV_32F);
  for (int row = 0; row < depth.rows; ++row)
    for (int col = 0; col < depth.cols; ++col) {
      const float z = depth.at<float>(row, col);
      if (z <= 0) continue;
      const double scale = z / mean_z;
      const double r =
          residual_along_z(plane, {rays.x.at<double>(row, col), rays.y.at<double>(row, col), z}) / (scale * scale);
      // Clipped: one flying pixel must not take its surroundings with it.
      sum.at<float>(row, col) = static_cast<float>(std::clamp(r / threshold, -4.0, 4.0));
      count.at<float>(row, col) = 1;
    }
  cv::boxFilter(sum, sum, CV_32F, {9, 9}, {-1, -1}, true, cv::BORDER_CONSTANT);
  cv::boxFilter(count, count, CV_32F, {9, 9}, {-1, -1}, true, cv::BORDER_CONSTANT);
  cv::Mat flat = cv::Mat::zeros(depth.size(), CV_8U);
  for (int row = 0; row < depth.rows; ++row)
    for (int col = 0; col < depth.cols; ++col) {
      const float share = count.at<float>(row, col);
      // A third of the pixels: 40 % at random missing is still a surface.
      if (share > 0.33f && std::abs(sum.at<float>(row, col)) < share) flat.at<std::uint8_t>(row, col) = 255;
    }
  cv::morphologyEx(flat, flat, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_RECT, {7, 7}));
  largest_component(flat);
  return flat;
}

Error too_few(std::size_t pixels, int wanted) {
  return Error(fmt::format("a plane fit needs {} measured pixels; the region has {}", wanted, pixels));
}

}  // namespace

PixelRays::PixelRays(const Camera& the_camera) : camera(the_camera) {
  cv::Mat apart[2];
  cv::split(exact_ray_table(camera), apart);
  x = apart[0];
  y = apart[1];
}

cv::Mat PlaneFit::perfect_depth(const PixelRays& rays) const {
  cv::Mat depth(rays.x.size(), CV_32F);
  for (int row = 0; row < depth.rows; ++row)
    for (int col = 0; col < depth.cols; ++col)
      depth.at<float>(row, col) =
          static_cast<float>(depth_mm(rays.x.at<double>(row, col), rays.y.at<double>(row, col)));
  return depth;
}

cv::Mat find_flat_region(const cv::Mat& depth, const PixelRays& rays, const PlaneFitOptions& options) {
  check_depth(depth, rays, {});
  const auto samples = gather(depth, rays, {}, 6000);
  if (static_cast<int>(samples.size()) < std::min(options.min_pixels, 6000))
    throw too_few(samples.size(), options.min_pixels);
  double mean_z = 0;
  for (const auto& s : samples) mean_z += s.z / samples.size();

  double share = 0;
  const double threshold = first_threshold(depth, {}, mean_z);
  Plane plane = ransac(samples, threshold, RandomStream(options.seed).child("flat region"), true, 600, share);
  cv::Mat region = flat_part(depth, rays, plane, threshold, mean_z);
  // The region and its plane sharpen each other.
  for (int round = 0; round < 4; ++round) {
    const auto inside = gather(depth, rays, region, 20000);
    if (static_cast<int>(inside.size()) < options.min_pixels) break;
    const Weighted fit = refine(inside, plane, options.sigma_exponent, threshold / 4);
    plane = fit.plane;
    const double tighter = std::min(threshold, std::max(2.5 * fit.sigma_mm, 0.001 * mean_z));
    region = flat_part(depth, rays, plane, tighter, fit.mean_z);
  }
  cv::erode(region, region, cv::getStructuringElement(cv::MORPH_RECT, {7, 7}), {-1, -1}, 1, cv::BORDER_CONSTANT, 0);
  largest_component(region);
  if (cv::countNonZero(region) < options.min_pixels)
    throw Error(fmt::format("no plane found: the largest flat region has {} pixels, a fit needs {}",
                            cv::countNonZero(region), options.min_pixels));
  return region;
}

PlaneFit fit_plane(const cv::Mat& depth, const PixelRays& rays, const cv::Mat& mask, const PlaneFitOptions& options) {
  check_depth(depth, rays, mask);
  PlaneFit fit;
  const bool given = !mask.empty();
  fit.region = given ? cv::Mat(mask > 0) : find_flat_region(depth, rays, options);
  const auto samples = gather(depth, rays, fit.region, static_cast<std::size_t>(-1));
  if (static_cast<int>(samples.size()) < options.min_pixels) throw too_few(samples.size(), options.min_pixels);

  const auto some = gather(depth, rays, fit.region, 3000);
  double mean_z = 0, share = 0;
  for (const auto& s : some) mean_z += s.z / some.size();
  const double threshold = first_threshold(depth, fit.region, mean_z);
  const Plane start = ransac(some, threshold, RandomStream(options.seed).child("plane"), false, 300, share);
  if (share < 0.5)
    throw Error(fmt::format("no plane: at most {:.0f} % of the region's pixels lie within {:.2g} mm of one plane",
                            100 * share, threshold));
  const Weighted refined = refine(samples, start, options.sigma_exponent, threshold / 4);
  const Plane& plane = refined.plane;

  double centre_x = 0, centre_y = 0;
  for (const auto& s : samples) centre_x += s.x / samples.size(), centre_y += s.y / samples.size();
  fit.incidence_rad = incidence(plane, centre_x, centre_y);
  if (!(fit.incidence_rad <= options.max_incidence_rad))
    throw Error(
        fmt::format("the plane is seen at {:.1f} deg from its normal; beyond {:.0f} deg its depth says nothing "
                    "about noise",
                    fit.incidence_rad * 180 / std::numbers::pi, options.max_incidence_rad * 180 / std::numbers::pi));

  fit.normal = normal_of(plane);
  fit.offset_mm = -1 / plane.norm();
  fit.sigma_mm = refined.sigma_mm;
  fit.fill_share = static_cast<double>(samples.size()) / cv::countNonZero(fit.region);
  fit.valid = cv::Mat::zeros(depth.size(), CV_8U);
  fit.residual_mm = cv::Mat::zeros(depth.size(), CV_32F);
  double squares = 0, orthogonal_squares = 0;
  std::size_t inliers = 0;
  // Quantised depth can have a robust sigma of next to nothing.
  const double sigma = std::max(refined.sigma_mm, 2e-4 * refined.mean_z);
  for (int row = 0; row < depth.rows; ++row)
    for (int col = 0; col < depth.cols; ++col) {
      const float z = depth.at<float>(row, col);
      if (z <= 0 || fit.region.at<std::uint8_t>(row, col) == 0) continue;
      const double x = rays.x.at<double>(row, col), y = rays.y.at<double>(row, col);
      const double plane_z = fit.depth_mm(x, y), r = z - plane_z;
      const double standardised = std::abs(r) / (sigma * std::pow(z / refined.mean_z, options.sigma_exponent));
      inliers += standardised < 4;
      if (plane_z <= 0 || standardised > 8) continue;
      fit.valid.at<std::uint8_t>(row, col) = 255;
      fit.residual_mm.at<float>(row, col) = static_cast<float>(r);
      fit.distance_mm += plane_z;
      squares += r * r;
      const double across = r * fit.normal.dot(Vector3(x, y, 1));
      orthogonal_squares += across * across;
      ++fit.pixels;
    }
  if (fit.pixels < options.min_pixels) throw too_few(fit.pixels, options.min_pixels);
  fit.inlier_share = static_cast<double>(inliers) / samples.size();
  fit.distance_mm /= fit.pixels;
  fit.rms_z_mm = std::sqrt(squares / fit.pixels);
  fit.rms_orthogonal_mm = std::sqrt(orthogonal_squares / fit.pixels);

  // Correlated pixels count for less: a block's mean of m independent pixels would have the variance / m.
  double block_squares = 0, expected = 0;
  constexpr int block = 16;
  for (int row = 0; row + block <= depth.rows; row += block)
    for (int col = 0; col + block <= depth.cols; col += block) {
      const cv::Rect place(col, row, block, block);
      const int n = cv::countNonZero(fit.valid(place));
      if (n < block * block / 2) continue;
      const double mean = cv::sum(fit.residual_mm(place))[0] / n;
      block_squares += mean * mean;
      expected += squares / fit.pixels / n;
    }
  const double inflation = expected > 0 ? std::max(1.0, block_squares / expected) : 1.0;
  const double sigma_inverse = fit.rms_z_mm / (refined.mean_z * refined.mean_z);
  fit.covariance = refined.unscaled_covariance * (sigma_inverse * sigma_inverse * inflation);
  return fit;
}

}  // namespace binrig
