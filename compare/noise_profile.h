// Everything that is said of the noise of one capture of a plane. Measured and simulated captures go through the same
// code; nothing here knows which is which.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "compare/noise/autocovariance.h"
#include "compare/noise/gaussianity.h"
#include "compare/noise/marginal.h"
#include "compare/noise/pixel_maps.h"
#include "compare/noise/plane_metrics.h"
#include "compare/noise/quantisation.h"
#include "compare/noise/row_column.h"
#include "compare/noise/spectrum_estimate.h"
#include "compare/noise/stationarity.h"
#include "compare/noise/temporal.h"
#include "compare/noise/whiteness.h"

namespace binrig {

/// "The noise" is temporal where the capture has repeats: the residual minus the pixel's mean over frames, times
/// sqrt(n / (n - 1)). With a single frame it is the spatial residual, which holds the fixed pattern, too: an upper
/// bound.
struct NoiseProfile {
  std::string name;
  int frames = 0;
  bool temporal = false;
  double distance_mm = 0;
  cv::Rect box;  ///< smallest rectangle around the region

  Estimate sigma_mm;  ///< standard deviation of the noise
  MarginalSummary marginal;
  TestResult gaussian;
  std::vector<float> independent_values;  ///< far enough apart to compare distributions
  Thinning spacing;
  std::shared_ptr<Autocovariance> autocovariance;
  cv::Mat covariance;
  NoiseSpectrum density;
  RingSpectrum spectrum;
  std::vector<double> autocorrelation;  ///< over distance, px
  Estimate correlation_length_px;
  TestResult white;
  RowColumnNoise lines;
  TemporalSummary time;
  NoiseSplit split;
  PlaneMetrics metrics;
  QuantisationStep quantisation;
  Stationarity stationarity;

  /// Images of the whole camera (CV_32F; CV_8U masks).
  cv::Mat bias_mm, bias_known, temporal_sigma_mm, fill;
  cv::Mat first_depth_mm, first_residual_mm, first_valid;
  Estimate bias_sigma_mm;   ///< standard deviation of the bias map over space
  cv::Mat bias_covariance;  ///< of the bias map; temporal noise over T is still in it
};

/// Reads the capture's frames twice. Memory does not grow with their number. Throws Error: region and camera do not
/// fit, fewer than 500 px with a depth, no frame.
NoiseProfile noise_profile(const PlaneCapture& capture);

/// Everything but images.
nlohmann::json profile_json(const NoiseProfile& profile);
nlohmann::json test_json(const TestResult& test);

}  // namespace binrig
