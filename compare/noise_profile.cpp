#include "compare/noise_profile.h"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace binrig {

namespace {

/// Cells large enough for about 40 effective samples each, so that the logarithm of their variance is nearly normal.
int cell_side(const cv::Mat& covariance, const cv::Size& box, int frames) {
  const int middle = covariance.rows / 2;
  const double variance = covariance.at<double>(middle, middle);
  double lags = 0;
  for (int i = 0; i < covariance.rows * covariance.cols && variance > 0; ++i) {
    const double rho = covariance.at<double>(i / covariance.cols, i % covariance.cols) / variance;
    if (std::abs(rho) > 0.05) lags += rho * rho;
  }
  const int wanted = static_cast<int>(std::ceil(std::sqrt(40 * std::max(1.0, lags) / std::min(frames, 40))));
  return std::clamp(wanted, 16, std::max(16, std::min(box.width, box.height) / 4));
}

/// The frame's temporal residual: departure from the pixel's mean, brought to full variance.
ResidualFrame temporal_residual(const ResidualFrame& frame, const cv::Mat& mean, const cv::Mat& known,
                                const cv::Mat& count) {
  ResidualFrame out = frame;
  out.residual_mm = cv::Mat(mean.size(), CV_32F, cv::Scalar(0));
  out.valid = cv::Mat(mean.size(), CV_8U, cv::Scalar(0));
  out.pixels = 0;
  for (int r = 0; r < mean.rows; ++r) {
    for (int c = 0; c < mean.cols; ++c) {
      const float n = count.at<float>(r, c);
      if (!known.at<std::uint8_t>(r, c) || !frame.valid.at<std::uint8_t>(r, c)) continue;
      out.residual_mm.at<float>(r, c) =
          (frame.residual_mm.at<float>(r, c) - mean.at<float>(r, c)) * std::sqrt(n / (n - 1));
      out.valid.at<std::uint8_t>(r, c) = 1;
      ++out.pixels;
    }
  }
  return out;
}

double deviation(const cv::Mat& residual, const cv::Mat& valid) {
  cv::Scalar mean, sigma;
  cv::meanStdDev(residual, mean, sigma, valid);
  return sigma[0];
}

Estimate root(const Estimate& variance) {
  const double value = std::sqrt(std::max(0.0, variance.value));
  return {value, value > 0 ? 0.5 * variance.standard_error / value : 0, variance.degrees_of_freedom};
}

}  // namespace

NoiseProfile noise_profile(const PlaneCapture& capture) {
  const PlaneResidual plane(capture.camera, capture.target);
  NoiseProfile out;
  out.name = capture.name;
  out.box = plane.box();
  out.distance_mm = plane.mean_distance_mm();

  PixelMaps maps(plane.plane_mm().size(), plane.region());
  PlaneMetricsSum metrics(capture, plane);
  TemporalNoise time;
  ValueLevels levels;
  double pixels = 0;
  capture.frames([&](const Frame& frame, int) {
    if (frame.depth_mm.empty()) return;  // a timeout carries no image
    const ResidualFrame residual = plane(frame);
    maps.add(residual);
    metrics.add(frame, residual);
    time.add(residual);
    levels.add(frame.depth_mm, residual.valid, frame.depth_scale_mm);
    if (out.first_residual_mm.empty()) {
      out.first_depth_mm = frame.depth_mm.clone();
      out.first_residual_mm = residual.residual_mm.clone();
      out.first_valid = residual.valid.clone();
    }
    pixels += residual.pixels;
  });
  out.frames = maps.frames();
  if (out.frames == 0) throw Error("capture " + capture.name + " has no frame");
  if (pixels / out.frames < smallest_region) {
    throw Error(fmt::format("capture {}: only {:.0f} px of the plane have a depth, statistics of noise need {}",
                            capture.name, pixels / out.frames, smallest_region));
  }
  out.temporal = out.frames >= 2;
  out.bias_mm = maps.mean_mm();
  out.bias_known = maps.known();
  out.temporal_sigma_mm = maps.temporal_sigma_mm();
  out.fill = maps.fill();
  out.time = time.finish();
  out.split = maps.split();
  out.metrics = metrics.finish(maps);
  out.quantisation = levels.finish();

  const int max_lag = suitable_max_lag(out.box.size());
  out.autocovariance = std::make_shared<Autocovariance>(max_lag);
  std::unique_ptr<CellVariance> cells;
  SampleStore normal_sample, comparison_sample;
  std::unique_ptr<Marginal> marginal;
  const cv::Mat& mean = out.bias_mm;
  capture.frames([&](const Frame& frame, int) {
    if (frame.depth_mm.empty()) return;
    ResidualFrame noise = plane(frame);
    if (out.temporal) noise = temporal_residual(noise, mean, out.bias_known, maps.count());
    const cv::Mat residual = noise.residual_mm(out.box), valid = noise.valid(out.box);
    out.autocovariance->add(residual, valid);
    if (!marginal) {
      // The first frame settles the histogram's scale and how far apart pixels are independent.
      marginal = std::make_unique<Marginal>(std::max(1e-6, deviation(residual, valid)));
      const cv::Mat covariance = out.autocovariance->covariance();
      out.spacing = thinning(covariance, out.autocovariance->pairs());
      cells = std::make_unique<CellVariance>(out.box.size(), cell_side(covariance, out.box.size(), out.frames));
    }
    marginal->add(residual, valid);
    cells->add(residual, valid);
    normal_sample.add(residual, valid, out.spacing.for_normality);
    comparison_sample.add(residual, valid, out.spacing.for_comparison);
  });
  out.marginal = marginal->finish();
  out.gaussian = gaussianity(normal_sample.values());
  out.independent_values = comparison_sample.values();
  out.covariance = out.autocovariance->covariance();
  const cv::Mat pairs = out.autocovariance->pairs();
  out.density = spectral_density(out.covariance);
  out.spectrum = ring_spectrum(*out.autocovariance);
  out.autocorrelation = radial_autocorrelation(out.covariance);
  const auto estimates = out.autocovariance->estimate([&](const cv::Mat& c) {
    return std::vector<double>{c.at<double>(c.rows / 2, c.cols / 2), correlation_length_px(c)};
  });
  out.sigma_mm = root(estimates[0]);
  out.correlation_length_px = estimates[1];
  out.white = whiteness(out.covariance, pairs);
  out.lines = row_column_noise(*out.autocovariance);
  out.stationarity = cells->finish(out.covariance, out.marginal.excess_kurtosis, plane.plane_mm()(out.box));

  Autocovariance bias(max_lag);
  bias.add(out.bias_mm(out.box), out.bias_known(out.box));
  out.bias_covariance = bias.covariance();
  out.bias_sigma_mm = root(
      bias.estimate([](const cv::Mat& c) { return std::vector<double>{c.at<double>(c.rows / 2, c.cols / 2)}; })[0]);
  return out;
}

}  // namespace binrig
