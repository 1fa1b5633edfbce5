#include "core/sensor_model.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>

#include <yaml-cpp/yaml.h>

#include "core/recording_writer.h"
#include "core/yaml.h"

namespace binrig {
namespace {

constexpr double unbounded = std::numeric_limits<double>::infinity();
constexpr double pi = 3.14159265358979323846;

// ------------------------------------------------------------------------------------------------- checking

std::string bounds_of(const ParameterSpec& spec) { return number_text(spec.lower) + " .. " + number_text(spec.upper); }

void check_value(const ParameterSpec& spec, double value, const std::string& where, const std::string& key,
                 Violations& violations) {
  if (!(value >= spec.lower && value <= spec.upper)) {
    violations.add({where, key, number_text(value), spec.unit, bounds_of(spec), "is out of bounds"});
  } else if (spec.kind == ParameterKind::integer && value != std::round(value)) {
    violations.add({where, key, number_text(value), spec.unit, bounds_of(spec), "is not a whole number"});
  }
}

void check_instances(SensorModel& model, const EffectCatalogue& catalogue, Violations& violations) {
  std::set<std::string> ids;
  const EffectDeclaration* previous = nullptr;
  for (EffectInstance& instance : model.effects) {
    if (instance.id.empty()) instance.id = instance.effect;
    if (!ids.insert(instance.id).second) {
      violations.add(instance.where, instance.id, "is the id of two effects: give one of them another `id`");
    }
    const EffectDeclaration* declaration =
        instance.own_declaration ? &*instance.own_declaration : catalogue.find(instance.effect);
    if (!declaration) {
      const std::string near = nearest_word(instance.effect, catalogue.names());
      violations.add(instance.where, instance.effect,
                     "is no effect of this program" + (near.empty() ? std::string() : ": did you mean " + near + "?"));
      continue;
    }
    for (const ParameterSpec& spec : declaration->parameters) {
      auto [entry, added] = instance.values.try_emplace(spec.name, ParameterValue{spec.initial, {}, ""});
      if (!added) check_value(spec, entry->second.value, instance.where, instance.id + "." + spec.name, violations);
    }
    for (const OptionSpec& option : declaration->options) {
      auto [entry, added] = instance.options.try_emplace(option.name, option.default_value);
      const bool known = option.choices.empty() ||
                         std::find(option.choices.begin(), option.choices.end(), entry->second) != option.choices.end();
      if (!known) {
        std::string list;
        for (const std::string& choice : option.choices) list += (list.empty() ? "" : ", ") + choice;
        violations.add({instance.where, instance.id + "." + option.name, entry->second, "", list, "is not one of the choices"});
      }
      if (option.is_file && !entry->second.empty()) {
        const std::filesystem::path base = std::filesystem::path(model.file).parent_path();
        if (!std::filesystem::exists(base / entry->second)) {
          violations.add({instance.where, instance.id + "." + option.name, entry->second, "", "", "is no file"});
        }
      }
    }
    if (previous && declaration->stage < previous->stage) {
      violations.add(instance.where, instance.id,
                     std::string("acts in stage ") + stage_name(declaration->stage) + " and must stand before " +
                         previous->name + " of stage " + stage_name(previous->stage));
    }
    previous = declaration;
  }
}

// -------------------------------------------------------------------------------------------------- reading

}  // namespace

Camera read_camera(YamlMap& map) {
  Camera camera;
  camera.width = map.integer("width", 0, 1, 16384);
  camera.height = map.integer("height", 0, 1, 16384);
  if (camera.width == 0) map.missing("width", "px");
  if (camera.height == 0) map.missing("height", "px");
  if (const auto fov_deg = map.number("horizontal_fov_deg", 0.1, 175, "deg")) {
    camera.fx = camera.fy = 0.5 * camera.width / std::tan(0.5 * *fov_deg * pi / 180);
  }
  camera.fx = map.number("fx", camera.fx, 1, 1e6, "px");
  camera.fy = map.number("fy", camera.fy > 0 ? camera.fy : camera.fx, 1, 1e6, "px");
  if (camera.fx <= 0) map.missing("fx", "px, or horizontal_fov_deg");
  camera.cx = map.number("cx", 0.5 * (camera.width - 1), -1e5, 1e5, "px");
  camera.cy = map.number("cy", 0.5 * (camera.height - 1), -1e5, 1e5, "px");
  if (const auto k = map.numbers("distortion", 0, -1e4, 1e4, "1")) {
    if (k->size() > 8) map.violation("distortion", "has more than the 8 coefficients k1 k2 p1 p2 k3 k4 k5 k6");
    std::copy_n(k->begin(), std::min<std::size_t>(8, k->size()), camera.distortion.begin());
  }
  map.finish();
  return camera;
}

namespace {

// `recording`, `fit` (where allowed) or a number.
Given read_given(YamlMap& map, const std::string& key, bool fit_allowed, const std::string& unit, double& value) {
  const YAML::Node node = map.node(key);
  if (!node.IsDefined() || (node.IsScalar() && node.Scalar() == "recording")) return Given::recording;
  if (fit_allowed && node.IsScalar() && node.Scalar() == "fit") return Given::fit;
  if (const auto number = map.number(key, 1e-9, 1e6, unit)) value = *number;
  return Given::written;
}

std::optional<std::array<double, 2>> read_interval(YamlMap& map, const std::string& key, const std::string& unit) {
  const auto pair = map.numbers(key, 2, -unbounded, unbounded, unit);
  if (!pair) return std::nullopt;
  if ((*pair)[0] > (*pair)[1]) map.violation(key, "has its ends in the wrong order");
  return std::array<double, 2>{(*pair)[0], (*pair)[1]};
}

ParameterValue read_value(YamlMap& map, const std::string& key) {
  ParameterValue value;
  if (map.node(key).IsMap()) {
    YamlMap parts = *map.map(key);
    value.value = parts.number("value", 0, -unbounded, unbounded, "");
    if (!parts.has("value")) parts.missing("value", "the number itself");
    value.ci95 = read_interval(parts, "ci95", "");
    value.provenance = parts.text("provenance", "");
    parts.finish();
  } else {
    value.value = map.number(key, 0, -unbounded, unbounded, "");
  }
  return value;
}

// The declaration of a user-defined effect: the catalogue's, with stage and parameters from the model file.
EffectDeclaration read_own_declaration(const EffectDeclaration& base, EffectInstance& instance, YamlMap& map) {
  EffectDeclaration own = base;
  own.stage = stage_from_name(map.text("stage", "geometry", stage_names())).value_or(Stage::geometry);
  if (auto parameters = map.map("parameters")) {
    for (const std::string& name : parameters->keys()) {
      ParameterSpec spec;
      spec.name = name;
      spec.lower = -1e9;
      spec.upper = 1e9;
      spec.meaning = "parameter of the expression";
      if (parameters->node(name).IsMap()) {
        YamlMap parts = *parameters->map(name);
        spec.unit = parts.text("unit", "1");
        if (const auto bounds = read_interval(parts, "bounds", spec.unit)) {
          spec.lower = (*bounds)[0];
          spec.upper = (*bounds)[1];
        }
        spec.neutral = parts.number("neutral", -unbounded, unbounded, spec.unit);
        ParameterValue value;
        value.value = parts.number("value", 0, -unbounded, unbounded, spec.unit);
        value.ci95 = read_interval(parts, "ci95", spec.unit);
        value.provenance = parts.text("provenance", "");
        parts.finish();
        instance.values[name] = value;
      } else {
        spec.unit = "1";
        instance.values[name] = read_value(*parameters, name);
      }
      spec.initial = instance.values[name].value;
      const double reach = std::max(std::abs(spec.lower), std::abs(spec.upper));
      spec.typical_high = reach < 1e9 ? reach : std::max(1.0, 10 * std::abs(spec.initial));
      spec.typical_low = spec.typical_high / 100;
      spec.either_sign = spec.lower < 0;
      own.parameters.push_back(spec);
    }
    parameters->finish();
  }
  if (own.amplitude.empty() && !own.parameters.empty()) own.amplitude = own.parameters.front().name;
  return own;
}

EffectInstance read_instance(YamlMap& item, const EffectCatalogue& catalogue, const std::string& file,
                             Violations& violations) {
  EffectInstance instance;
  instance.where = item.where();
  const std::vector<std::string> keys = item.keys();
  if (keys.size() != 1) {
    violations.add(instance.where, "effects", "each entry is one effect: `- name: {parameters}`");
    return instance;
  }
  instance.effect = keys[0];
  const EffectDeclaration* declaration = catalogue.find(instance.effect);
  std::optional<YamlMap> inner = item.map(instance.effect);
  if (!inner || !declaration) return instance;  // the unknown name is reported by check_instances
  YamlMap& map = *inner;
  instance.id = map.text("id", instance.effect);
  instance.provenance = map.text("provenance", "");
  if (declaration->user_defined) instance.own_declaration = read_own_declaration(*declaration, instance, map);
  for (const ParameterSpec& spec : declaration->parameters) {
    if (map.has(spec.name)) instance.values[spec.name] = read_value(map, spec.name);
  }
  for (const OptionSpec& option : declaration->options) {
    if (const auto text = map.text(option.name)) instance.options[option.name] = *text;
  }
  map.finish();
  return instance;
}

void read_instrument(YamlMap& map, SensorModel& model) {
  auto instrument = map.map("instrument");
  if (!instrument) return;
  for (const std::string& key : instrument->keys()) {
    double value = 0;
    const YAML::Node node = instrument->node(key);
    if (node.IsScalar() && YAML::convert<double>::decode(node, value)) {
      model.instrument[key] = value;
    } else if (const auto text = instrument->text(key)) {
      model.instrument_options[key] = *text;
    }
  }
  instrument->finish();
}

}  // namespace

const EffectDeclaration& EffectInstance::declaration(const EffectCatalogue& catalogue) const {
  if (own_declaration) return *own_declaration;
  const EffectDeclaration* declaration = catalogue.find(effect);
  if (!declaration) throw Error("there is no effect named " + effect);
  return *declaration;
}

const EffectInstance* SensorModel::find(const std::string& id) const {
  for (const EffectInstance& instance : effects) {
    if (instance.id == id) return &instance;
  }
  return nullptr;
}

SensorModel parse_sensor_model(const std::string& yaml_text, const std::string& name, const EffectCatalogue& catalogue) {
  Violations violations;
  SensorModel model;
  model.file = name;
  YamlMap map(parse_yaml(yaml_text, name), name, "", violations);
  model.name = map.text("name", std::filesystem::path(name).stem().string());
  model.description = map.text("description", "");
  model.dot_pattern = map.text("sensor", "effects", {"effects", "dot_pattern"}) == "dot_pattern";

  if (map.node("camera").IsMap()) {
    model.camera_from = Given::written;
    YamlMap camera = *map.map("camera");
    model.camera = read_camera(camera);
  } else {
    map.text("camera", "recording", {"recording"});
  }

  const YAML::Node projector = map.node("projector");
  if (projector.IsMap()) {
    YamlMap place = *map.map("projector");
    const bool fit = place.boolean("fit", false);
    model.projector_from = fit ? Given::fit : Given::written;
    model.projector_known = true;
    model.projector_xyz_mm = Vector3(place.number("x", 0, -1e4, 1e4, "mm"), place.number("y", 0, -1e4, 1e4, "mm"),
                                     place.number("z", 0, -1e4, 1e4, "mm"));
    if (!place.has("x")) place.missing("x", "mm, in the camera frame");
    place.finish();
  } else if (map.text("projector", "recording", {"recording", "fit"}) == "fit") {
    model.projector_from = Given::fit;
  }

  model.reference_from = read_given(map, "reference_distance", false, "mm", model.reference_distance_mm);
  model.depth_scale_from = read_given(map, "depth_scale", false, "mm", model.depth_scale_mm);
  model.frame_rate_hz = map.number("frame_rate_hz", 1e-3, 1e4, "Hz");
  model.range_mm = read_interval(map, "range_mm", "mm");
  model.unit_seed = static_cast<std::uint64_t>(map.number("unit_seed", 1, 0, 9e15, ""));
  for (YamlMap& item : map.maps("effects")) model.effects.push_back(read_instance(item, catalogue, name, violations));
  if (model.dot_pattern && !model.effects.empty()) {
    map.violation("effects", "a dot_pattern sensor has no effects: its imperfections are those of its instrument");
  }
  read_instrument(map, model);
  if (!model.dot_pattern && map.has("instrument")) map.violation("instrument", "belongs to sensor: dot_pattern");
  map.finish();
  check_instances(model, catalogue, violations);
  violations.throw_if_any("the sensor model " + name + " is not usable");
  return model;
}

SensorModel read_sensor_model(const std::string& path, const EffectCatalogue& catalogue) {
  std::ifstream file(path);
  std::stringstream text;
  if (!(file && text << file.rdbuf())) throw Error("cannot read the sensor model " + path);
  return parse_sensor_model(text.str(), path, catalogue);
}

void check_sensor_model(SensorModel& model, const EffectCatalogue& catalogue) {
  Violations violations;
  check_instances(model, catalogue, violations);
  violations.throw_if_any("the sensor model " + model.name + " is not usable");
}

std::string free_id(const SensorModel& model, const std::string& wanted) {
  std::string id = wanted;
  for (int n = 2; model.find(id); ++n) id = wanted + "_" + std::to_string(n);
  return id;
}

EffectInstance& add_effect(SensorModel& model, const EffectCatalogue& catalogue, EffectInstance instance) {
  instance.id = free_id(model, instance.id);
  const auto stage = [&](const EffectInstance& effect) { return effect.declaration(catalogue).stage; };
  std::size_t index = 0;
  for (std::size_t i = 0; i < model.effects.size(); ++i)
    if (stage(model.effects[i]) <= stage(instance)) index = i + 1;
  model.effects.insert(model.effects.begin() + static_cast<std::ptrdiff_t>(index), std::move(instance));
  check_sensor_model(model, catalogue);
  return model.effects[index];
}

EffectInstance& add_effect(SensorModel& model, const EffectCatalogue& catalogue, const std::string& effect,
                           const std::map<std::string, double>& values) {
  if (!catalogue.find(effect)) throw Error("there is no effect named " + effect);
  EffectInstance instance;
  instance.effect = instance.id = effect;
  for (const auto& [name, value] : values) instance.values[name].value = value;
  return add_effect(model, catalogue, std::move(instance));
}

// -------------------------------------------------------------------------------------------------- writing

namespace {

void emit_value(YAML::Emitter& out, const ParameterValue& value, const ParameterSpec* own) {
  if (!value.ci95 && value.provenance.empty() && !own) {
    out << number_text(value.value);
    return;
  }
  out << YAML::Flow << YAML::BeginMap << YAML::Key << "value" << YAML::Value << number_text(value.value);
  if (own) {
    out << YAML::Key << "unit" << YAML::Value << own->unit;
    if (own->lower > -1e9 || own->upper < 1e9) {
      out << YAML::Key << "bounds" << YAML::Value << YAML::BeginSeq << number_text(own->lower)
          << number_text(own->upper) << YAML::EndSeq;
    }
    if (own->neutral) out << YAML::Key << "neutral" << YAML::Value << number_text(*own->neutral);
  }
  if (value.ci95) {
    out << YAML::Key << "ci95" << YAML::Value << YAML::BeginSeq << number_text((*value.ci95)[0])
        << number_text((*value.ci95)[1]) << YAML::EndSeq;
  }
  if (!value.provenance.empty()) out << YAML::Key << "provenance" << YAML::Value << YAML::DoubleQuoted << value.provenance;
  out << YAML::EndMap << YAML::Block;
}

void emit_instance(YAML::Emitter& out, const EffectInstance& instance, const EffectCatalogue& catalogue) {
  const EffectDeclaration& declaration = instance.declaration(catalogue);
  out << YAML::BeginMap << YAML::Key << instance.effect << YAML::Value << YAML::BeginMap;
  if (instance.id != instance.effect) out << YAML::Key << "id" << YAML::Value << instance.id;
  if (!instance.provenance.empty()) {
    out << YAML::Key << "provenance" << YAML::Value << YAML::DoubleQuoted << instance.provenance;
  }
  if (instance.own_declaration) out << YAML::Key << "stage" << YAML::Value << stage_name(declaration.stage);
  for (const OptionSpec& option : declaration.options) {
    const auto found = instance.options.find(option.name);
    if (found == instance.options.end() || found->second == option.default_value) continue;
    out << YAML::Key << option.name << YAML::Value << YAML::DoubleQuoted << found->second;
  }
  const bool own = instance.own_declaration.has_value();
  if (own) out << YAML::Key << "parameters" << YAML::Value << YAML::BeginMap;
  for (const ParameterSpec& spec : declaration.parameters) {
    const auto found = instance.values.find(spec.name);
    if (found == instance.values.end()) continue;
    out << YAML::Key << spec.name << YAML::Value;
    emit_value(out, found->second, own ? &spec : nullptr);
  }
  if (own) out << YAML::EndMap;
  out << YAML::EndMap << YAML::EndMap;
}

void emit_given(YAML::Emitter& out, const char* key, Given given, double value) {
  out << YAML::Key << key << YAML::Value << (given == Given::written ? number_text(value) : std::string("recording"));
}

}  // namespace

std::string sensor_model_yaml(const SensorModel& model, const EffectCatalogue& catalogue) {
  YAML::Emitter out;
  out << YAML::BeginMap << YAML::Key << "name" << YAML::Value << model.name;
  if (!model.description.empty()) out << YAML::Key << "description" << YAML::Value << YAML::DoubleQuoted << model.description;
  out << YAML::Key << "sensor" << YAML::Value << (model.dot_pattern ? "dot_pattern" : "effects");
  out << YAML::Key << "camera" << YAML::Value;
  if (model.camera_from == Given::written) {
    const Camera& c = model.camera;
    out << YAML::Flow << YAML::BeginMap << YAML::Key << "width" << YAML::Value << c.width << YAML::Key << "height"
        << YAML::Value << c.height;
    for (auto [key, value] : {std::pair{"fx", c.fx}, {"fy", c.fy}, {"cx", c.cx}, {"cy", c.cy}}) {
      out << YAML::Key << key << YAML::Value << number_text(value);
    }
    if (c.distorted()) {
      out << YAML::Key << "distortion" << YAML::Value << YAML::BeginSeq;
      for (double k : c.distortion) out << number_text(k);
      out << YAML::EndSeq;
    }
    out << YAML::EndMap << YAML::Block;
  } else {
    out << "recording";
  }
  out << YAML::Key << "projector" << YAML::Value;
  if (model.projector_known) {
    out << YAML::Flow << YAML::BeginMap;
    if (model.projector_from == Given::fit) out << YAML::Key << "fit" << YAML::Value << true;
    const Vector3& p = model.projector_xyz_mm;
    for (auto [key, value] : {std::pair{"x", p.x()}, {"y", p.y()}, {"z", p.z()}}) {
      out << YAML::Key << key << YAML::Value << number_text(value);
    }
    out << YAML::EndMap << YAML::Block;
  } else {
    out << (model.projector_from == Given::fit ? "fit" : "recording");
  }
  emit_given(out, "reference_distance", model.reference_from, model.reference_distance_mm);
  emit_given(out, "depth_scale", model.depth_scale_from, model.depth_scale_mm);
  if (model.frame_rate_hz) out << YAML::Key << "frame_rate_hz" << YAML::Value << number_text(*model.frame_rate_hz);
  if (model.range_mm) {
    out << YAML::Key << "range_mm" << YAML::Value << YAML::Flow << YAML::BeginSeq << number_text((*model.range_mm)[0])
        << number_text((*model.range_mm)[1]) << YAML::EndSeq << YAML::Block;
  }
  if (model.unit_seed != 1) out << YAML::Key << "unit_seed" << YAML::Value << model.unit_seed;
  if (!model.effects.empty()) {
    out << YAML::Key << "effects" << YAML::Value << YAML::BeginSeq;
    for (const EffectInstance& instance : model.effects) emit_instance(out, instance, catalogue);
    out << YAML::EndSeq;
  }
  if (model.dot_pattern) {
    out << YAML::Key << "instrument" << YAML::Value << YAML::BeginMap;
    for (const auto& [key, value] : model.instrument) out << YAML::Key << key << YAML::Value << number_text(value);
    for (const auto& [key, value] : model.instrument_options) out << YAML::Key << key << YAML::Value << value;
    out << YAML::EndMap;
  }
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

void write_sensor_model(const SensorModel& model, const EffectCatalogue& catalogue, const std::string& path) {
  write_file_atomically(path, sensor_model_yaml(model, catalogue));
}

}  // namespace binrig
