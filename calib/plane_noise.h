// The noise of one capture of a plane: of single frames, and where frames repeat, split into temporal noise and fixed
// pattern. Measured and simulated frames go through the same code.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/low_frequencies.h"
#include "calib/noise_spectrum.h"
#include "calib/plane_fit.h"
#include "compare/noise/plane_residual.h"
#include "compare/noise/stationarity.h"
#include "core/recording_set.h"

namespace binrig {

/// What the first frame says, enough to choose drop order and lags for a whole set.
struct FirstLook {
  std::string key, name;
  int frames = 0;
  bool region_given = false;  ///< by the recording's mask; else found
  PlaneFit plane;
  /// Mean over the region's pixels of (theta / (pi/2 - theta))^2, incidence_noise's term: it grows so steeply that its
  /// mean is not that of the mean angle.
  double incidence_term = 0;
  std::vector<double> order_powers;
  double depth_scale_mm = 0;
  Camera camera;
};

/// Throws Error naming the capture: no frame, no plane (see fit_plane).
/// `region`: CV_8U, the flat part; empty = find it.
FirstLook look_at(const std::string& key, const std::string& name, const Frame& first, int frames,
                  const cv::Mat& region, const PlaneFitOptions& options = {});

struct CaptureNoise {
  FirstLook look;
  /// Of single frames' residuals with the low orders removed: fixed pattern and temporal noise together. Where there
  /// are no repeats this is all there is, an upper bound for the noise.
  SpectrumEstimate single;
  /// Of (frame i+1 - frame i) / sqrt 2 with each difference's plane removed (hand-held drift).
  std::optional<SpectrumEstimate> temporal;
  double fixed_variance_mm2 = 0;  ///< single minus temporal, low orders left out; may be slightly negative
  /// Variance of frames two apart over that of successive ones, minus 1: 0 = no memory from frame to frame; absent
  /// below 3 frames.
  std::optional<double> memory;
  double repeated_share = 0;  ///< frames equal to their predecessor: left out of the differences
  Stationarity stationarity;  ///< of noise() within the image
  double step_mm = 0;         ///< step of the stored values as found: the greatest common divisor of the counts
  int frames_used = 0;
  std::vector<std::string> remarks;  ///< what limits these numbers, in sentences

  const SpectrumEstimate& noise() const { return temporal ? *temporal : single; }
};

struct PlaneNoiseOptions {
  int max_lag_px = 0;  ///< 0 = choose_max_lag of this capture
  int drop_order = 1;
  int single_frames = 4;  ///< at most so many frames' residuals, evenly spread (they share their fixed pattern)
};

/// Reads the frames once; memory does not grow with their number. Every frame must have the camera of the first one.
/// Throws Error as SpectrumEstimator::add, naming capture and frame.
CaptureNoise measure_noise(const FirstLook& look, const FrameStream& frames, bool region_masks,
                           const PlaneNoiseOptions& options);

}  // namespace binrig
