// A sensor model: camera, projector and an ordered list of effects, or the first-principles instrument. A YAML file
// that round-trips.
//
//   name: thesis-five
//   sensor: effects                  # or dot_pattern
//   camera: recording                # or {width: 1280, height: 960, horizontal_fov_deg: 16.06} or {width, height, fx, fy, cx, cy, distortion}
//   projector: recording             # or fit, or {x: 100, y: 0, z: 0} (mm, camera frame)
//   reference_distance: recording    # z0 of EFFECTS.md: range_mm's middle, else the median depth of train; or mm
//   depth_scale: recording           # the storage step; or mm
//   frame_rate_hz: 3                 # optional; so are range_mm: [700, 900] and unit_seed: 7
//   effects:
//     - projector_shadow: {bias: 1.5}
//     - spectral_noise:
//         id: noise                  # default: the effect's name
//         sigma: {value: 0.21, ci95: [0.20, 0.22], provenance: "fitted: kit-a train, 2026-11-21"}
//     - formula: {id: bow, stage: geometry, on: depth, expression: "a*r2", parameters: {a: {value: 0.1, unit: mm, bounds: [-2, 2]}}}
//   instrument: {...}                # for sensor: dot_pattern; see sim/dot_pattern
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/effect_declaration.h"
#include "core/error.h"
#include "core/frame_source.h"

namespace binrig {

class YamlMap;

struct ParameterValue {
  double value = 0;
  std::optional<std::array<double, 2>> ci95;
  std::string provenance;  ///< "" = as written by hand
};

struct EffectInstance {
  std::string effect;  ///< name in the catalogue
  std::string id;      ///< unique in the model
  std::map<std::string, ParameterValue> values;  ///< complete after a check: absent keys hold the initial value
  std::map<std::string, std::string> options;
  std::optional<EffectDeclaration> own_declaration;  ///< for user-defined effects (formula)
  std::string provenance;  ///< why the effect is in the model: evidence and recording
  std::string where;       ///< file:line, for messages

  double value(const std::string& parameter) const { return values.at(parameter).value; }
  /// What this instance is: its own declaration, else the catalogue's (which must have it).
  const EffectDeclaration& declaration(const EffectCatalogue& catalogue) const;
};

/// Where a number of the model comes from.
enum class Given { recording, fit, written };

struct SensorModel {
  std::string name;
  std::string description;
  bool dot_pattern = false;
  Given camera_from = Given::recording;
  Camera camera;  ///< where written
  Given projector_from = Given::recording;
  Vector3 projector_xyz_mm = Vector3::Zero();  ///< where written; the fitted place where fit has found one
  bool projector_known = false;                ///< written, or fit and found
  Given reference_from = Given::recording;
  double reference_distance_mm = 0;
  Given depth_scale_from = Given::recording;
  double depth_scale_mm = 0;
  std::optional<double> frame_rate_hz;
  std::optional<std::array<double, 2>> range_mm;
  std::uint64_t unit_seed = 1;  ///< which specimen: keys the per-unit maps
  std::vector<EffectInstance> effects;
  std::map<std::string, double> instrument;             ///< dot_pattern's numbers, checked by sim/dot_pattern
  std::map<std::string, std::string> instrument_options;
  std::string file;  ///< where it was read from; spectrum files are relative to it

  const EffectInstance* find(const std::string& id) const;
};

/// Reads a camera as above from a mapping whose keys are the camera's alone; what is wrong becomes a violation.
/// Finishes `map`.
Camera read_camera(YamlMap& map);

/// Reads and checks a model. Throws one Error with every violation: unknown keys (with the nearest known one), unknown
/// effects, values out of bounds with unit and bounds, duplicate ids, effects against the order of stages, each with
/// file:line. Files named by options are checked for existence.
SensorModel read_sensor_model(const std::string& path, const EffectCatalogue& catalogue);
SensorModel parse_sensor_model(const std::string& yaml_text, const std::string& name_for_messages,
                               const EffectCatalogue& catalogue);

/// Fills absent values with their initial ones and checks everything that read_sensor_model checks, for a model made
/// in code.
void check_sensor_model(SensorModel& model, const EffectCatalogue& catalogue);

/// `wanted`, with _2, _3 ... where an instance of the model has it.
std::string free_id(const SensorModel& model, const std::string& wanted);

/// Puts the instance at its place among the stages: after the last one whose stage is not later. Its id is made free;
/// absent values are initial. The name of an effect stands for an instance with that id. Throws Error as
/// check_sensor_model does, and where the catalogue has no such effect.
EffectInstance& add_effect(SensorModel& model, const EffectCatalogue& catalogue, EffectInstance instance);
EffectInstance& add_effect(SensorModel& model, const EffectCatalogue& catalogue, const std::string& effect,
                           const std::map<std::string, double>& values = {});

/// YAML text that read_sensor_model turns back into an equal model. Numbers keep every digit.
std::string sensor_model_yaml(const SensorModel& model, const EffectCatalogue& catalogue);
/// Writes to a temporary name and renames. Throws Error if the file cannot be written.
void write_sensor_model(const SensorModel& model, const EffectCatalogue& catalogue, const std::string& path);

}  // namespace binrig
