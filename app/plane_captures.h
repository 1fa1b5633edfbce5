// The plane captures of a recording set, looked at and measured: what fit-noise and calibrate begin with.
#pragma once

#include <string>
#include <vector>

#include "calib/noise_fit.h"
#include "core/recording_set.h"

namespace binrig {

struct PlaneCaptures {
  RecordingSet set;
  std::vector<FirstLook> train, test;
  std::vector<std::string> notes;  ///< captures left out, and why
};

/// Looks at the first frame of every plane capture; with `only` ("train/1") that capture alone is train, whatever its
/// split and target: a flat region is looked for in a scene, too. Captures without a plane are left out and noted.
/// Throws Error: no such capture, or no plane capture to fit to.
PlaneCaptures open_plane_captures(const std::string& set, const std::string& only);

/// Chooses lags and drop order for the whole set and measures every capture. Captures that cannot be measured are
/// noted. Throws Error if no train capture is left.
LowFrequencies measure_plane_captures(PlaneCaptures& planes, std::vector<CaptureNoise>& train,
                                      std::vector<CaptureNoise>& test);

}  // namespace binrig
