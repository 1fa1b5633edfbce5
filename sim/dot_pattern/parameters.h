// The numbers of the first-principles instrument, as a model file's `instrument:` has them. One table (parameters.cpp)
// declares name, unit, bounds and meaning; checks, help and documentation read it.
#pragma once

#include <string>
#include <vector>

#include "core/sensor_model.h"

namespace binrig::dot_pattern {

enum class Principle { structured_light, active_stereo };
enum class Cost { zncc, census };

/// The initial values are the clean instrument. Pixels (px) are those of the matched image, which is `binning` times
/// finer than the depth image.
struct Parameters {
  Principle principle = Principle::structured_light;
  Cost cost = Cost::zncc;
  // the pattern
  double dot_spacing = 4.0, dot_sigma = 0.7, background = 0.05, pattern_seed = 1;
  // where things stand, against what the matcher believes
  double projector_share = 0.5, baseline_error = 0, yaw_error = 0, yaw_drift = 0, drift_time = 30;
  // optics
  double optics_sigma = 0.5, k1 = 0, k2 = 0, p1 = 0, p2 = 0, prism_x = 0, prism_y = 0;
  // light and sensor
  double exposure = 1.0, ambient = 0.02, ambient_spot = 0, spot_x = 0, spot_y = 0, spot_radius = 0.5;
  double full_well = 12000, read_noise = 15, bits = 10, frame_blend = 1;
  double dead_pixels = 0, dust_x = 0, dust_y = 0, dust_radius = 0, dust_opacity = 0.9;
  // the matcher
  double window = 11, min_correlation = 0.6, uniqueness = 0.05, max_left_right = 1.0, speckle_size = 60,
         speckle_step = 1.0, min_contrast = 0.004, saturated_share = 0.15, disparity_step = 0.0625;
  // resolution
  double binning = 1, supersampling = 2;
};

struct ParameterRow {
  std::string name, unit;
  double Parameters::*member;
  double lower, upper;
  bool whole;  ///< only whole numbers
  std::string meaning;
};
const std::vector<ParameterRow>& parameter_table();

/// Reads model.instrument and model.instrument_options. Throws one Error with every violation: unknown keys (with the
/// nearest known one), values out of bounds, an even window, an unknown choice.
Parameters read_parameters(const SensorModel& model);

}  // namespace binrig::dot_pattern
