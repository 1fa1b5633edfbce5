#include "sim/dot_pattern/parameters.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace binrig::dot_pattern {

const std::vector<ParameterRow>& parameter_table() {
  using P = Parameters;
  static const std::vector<ParameterRow> table{
      {"dot_spacing", "px", &P::dot_spacing, 2, 20, false, "mean distance between neighbouring dots"},
      {"dot_sigma", "px", &P::dot_sigma, 0.3, 4, false, "Gaussian radius of a projected dot"},
      {"background", "1", &P::background, 0, 0.9, false, "light between the dots, share of a dot's peak"},
      {"pattern_seed", "1", &P::pattern_seed, 0, 1e9, true, "which dot pattern"},
      {"projector_share", "1", &P::projector_share, 0, 1, false,
       "active stereo: where the projector stands on the way from the first to the second camera"},
      {"baseline_error", "mm", &P::baseline_error, -5, 5, false,
       "the second view (projector, or second camera) stands this much further along x than the matcher believes"},
      {"yaw_error", "rad", &P::yaw_error, -0.02, 0.02, false,
       "turn of the second view about y that the matcher does not know; positive raises the disparity by focal length "
       "times angle"},
      {"yaw_drift", "rad", &P::yaw_drift, -0.02, 0.02, false,
       "further turn at power-on, which dies away as the device warms up"},
      {"drift_time", "s", &P::drift_time, 0.1, 1e5, false, "time constant of yaw_drift"},
      {"optics_sigma", "px", &P::optics_sigma, 0, 8, false, "Gaussian blur of the camera's lens"},
      {"k1", "1", &P::k1, -0.5, 0.5, false, "residual radial distortion of the camera's lens (OpenCV's k1)"},
      {"k2", "1", &P::k2, -5, 5, false, "residual radial distortion of fourth order (OpenCV's k2)"},
      {"p1", "1", &P::p1, -0.05, 0.05, false, "residual decentring distortion (OpenCV's p1)"},
      {"p2", "1", &P::p2, -0.05, 0.05, false, "residual decentring distortion (OpenCV's p2)"},
      {"prism_x", "1", &P::prism_x, -0.2, 0.2, false,
       "thin-prism distortion: shifts the image along x by this times r^2 (OpenCV's s1)"},
      {"prism_y", "1", &P::prism_y, -0.2, 0.2, false,
       "thin-prism distortion: shifts the image along y by this times r^2 (OpenCV's s3)"},
      {"exposure", "1", &P::exposure, 0.002, 100, false,
       "share of the full well that the peak of a dot fills on a white surface at the reference distance"},
      {"ambient", "1", &P::ambient, 0, 20, false, "even ambient light, relative to the peak of a dot"},
      {"ambient_spot", "1", &P::ambient_spot, 0, 20, false, "peak of a Gaussian pool of ambient light"},
      {"spot_x", "1", &P::spot_x, -2, 2, false, "its centre, in half image widths from the principal point"},
      {"spot_y", "1", &P::spot_y, -2, 2, false, "its centre, in half image widths from the principal point"},
      {"spot_radius", "1", &P::spot_radius, 0.02, 5, false, "its standard deviation, in half image widths"},
      {"full_well", "e-", &P::full_well, 100, 1e7, false, "electrons at which a pixel is full"},
      {"read_noise", "e-", &P::read_noise, 0, 1000, false, "standard deviation of the read noise"},
      {"bits", "1", &P::bits, 6, 12, true, "the converter's resolution"},
      {"frame_blend", "1", &P::frame_blend, 0.02, 1, false,
       "the recorded image is this share of the new one and the rest of the one before; 1 = the new one alone"},
      {"dead_pixels", "1", &P::dead_pixels, 0, 0.1, false, "share of the camera's pixels that are always dark or full"},
      {"dust_x", "1", &P::dust_x, -2, 2, false, "a speck on the lens, in half image widths from the principal point"},
      {"dust_y", "1", &P::dust_y, -2, 2, false, "a speck on the lens, in half image widths from the principal point"},
      {"dust_radius", "px", &P::dust_radius, 0, 200, false, "its radius; 0 = none"},
      {"dust_opacity", "1", &P::dust_opacity, 0, 1, false, "share of the light that it takes"},
      {"window", "px", &P::window, 5, 31, true, "side of the square that is matched, odd"},
      {"min_correlation", "1", &P::min_correlation, 0, 1, false, "below this likeness (1 = alike) there is no match"},
      {"uniqueness", "1", &P::uniqueness, 0, 1, false,
       "how much likelier the best disparity must be than any other that is not its neighbour"},
      {"max_left_right", "px", &P::max_left_right, 0, 100, false,
       "accepted difference between the disparity here and that which the second view finds for its partner"},
      {"speckle_size", "px", &P::speckle_size, 0, 1e5, true, "islands of fewer pixels are removed"},
      {"speckle_step", "px", &P::speckle_step, 0.05, 20, false, "disparity step that separates an island"},
      {"min_contrast", "1", &P::min_contrast, 0, 1, false,
       "standard deviation in the window, share of full scale, below which the signal is too low"},
      {"saturated_share", "1", &P::saturated_share, 0, 1, false,
       "share of full pixels in the window above which it counts as saturated"},
      {"disparity_step", "px", &P::disparity_step, 0, 1, false, "the matcher's output is rounded to this; 0 = not"},
      {"binning", "1", &P::binning, 1, 8, true,
       "the camera's image is this many times finer than the depth image, which takes the median of each block"},
      {"supersampling", "1", &P::supersampling, 1, 6, true, "rays along each side of a pixel of the camera's image"},
  };
  return table;
}

Parameters read_parameters(const SensorModel& model) {
  Parameters parameters;
  Violations violations;
  const std::string where = model.file.empty() ? model.name : model.file;
  std::vector<std::string> names{"principle", "cost"};
  for (const ParameterRow& row : parameter_table()) names.push_back(row.name);
  const auto unknown = [&](const std::string& key) {
    const std::string nearest = nearest_word(key, names);
    violations.add(where, "instrument." + key,
                   "is not a key of the instrument" + (nearest.empty() ? "" : "; did you mean " + nearest + "?"));
  };

  for (const auto& [key, value] : model.instrument) {
    const auto row = std::find_if(parameter_table().begin(), parameter_table().end(),
                                  [&, k = key](const ParameterRow& r) { return r.name == k; });
    if (row == parameter_table().end()) {
      if (key == "principle" || key == "cost") {
        violations.add(where, "instrument." + key, "is a word, not a number");
      } else {
        unknown(key);
      }
      continue;
    }
    const bool inside = value >= row->lower && value <= row->upper;
    const bool wrong_number = row->whole && value != std::round(value);
    if (!inside || wrong_number) {
      violations.add({where, "instrument." + key, fmt::format("{:g}", value), row->unit,
                      fmt::format("{:g} .. {:g}", row->lower, row->upper),
                      inside ? "must be a whole number" : "is out of bounds"});
      continue;
    }
    parameters.*(row->member) = value;
  }
  if (std::fmod(parameters.window, 2) != 1) {
    violations.add({where, "instrument.window", fmt::format("{:g}", parameters.window), "px", "", "must be odd"});
  }
  for (const auto& [key, text] : model.instrument_options) {
    const auto refuse = [&](const std::string& choices) {
      violations.add({where, "instrument." + key, text, "", choices, "is not one of the choices"});
    };
    if (key == "principle") {
      if (text == "active_stereo") {
        parameters.principle = Principle::active_stereo;
      } else if (text != "structured_light") {
        refuse("structured_light, active_stereo");
      }
    } else if (key == "cost") {
      if (text == "census") {
        parameters.cost = Cost::census;
      } else if (text != "zncc") {
        refuse("zncc, census");
      }
    } else if (std::find(names.begin(), names.end(), key) != names.end()) {
      violations.add({where, "instrument." + key, text, "", "", "must be a number"});
    } else {
      unknown(key);
    }
  }
  violations.throw_if_any("the instrument of " + where + " cannot be built");
  return parameters;
}

}  // namespace binrig::dot_pattern
