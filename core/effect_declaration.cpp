#include "core/effect_declaration.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"

namespace binrig {
namespace {
constexpr const char* names_of_stages[] = {"view", "geometry", "matching", "signal_mask", "amplitude", "noise",
                                           "spatial",  "quantise", "temporal",    "device",    "storage"};
}

const char* stage_name(Stage stage) { return names_of_stages[static_cast<int>(stage)]; }

std::optional<Stage> stage_from_name(const std::string& name) {
  for (int i = 0; i < 10; ++i) {
    if (name == names_of_stages[i]) return static_cast<Stage>(i);
  }
  return std::nullopt;
}

std::vector<std::string> stage_names() { return {std::begin(names_of_stages), std::end(names_of_stages)}; }

std::vector<std::string> Needs::words() const {
  std::vector<std::string> list;
  if (baseline) list.push_back("baseline");
  if (power_on) list.push_back("power_on");
  if (motion) list.push_back("motion");
  if (repeats) list.push_back("repeats");
  if (ir) list.push_back("ir");
  return list;
}

const ParameterSpec* EffectDeclaration::parameter(const std::string& parameter_name) const {
  for (const ParameterSpec& spec : parameters) {
    if (spec.name == parameter_name) return &spec;
  }
  return nullptr;
}

const OptionSpec* EffectDeclaration::option(const std::string& option_name) const {
  for (const OptionSpec& spec : options) {
    if (spec.name == option_name) return &spec;
  }
  return nullptr;
}

double strength_value(const EffectDeclaration& declaration, Strength strength) {
  const ParameterSpec* spec = declaration.parameter(declaration.amplitude);
  if (!spec) throw Error("the effect " + declaration.name + " declares no amplitude parameter");
  const double share = strength == Strength::weak ? 0.15 : strength == Strength::medium ? 0.5 : 0.85;
  const double position = declaration.stronger_is_larger ? share : 1 - share;
  const double low = spec->typical_low, high = spec->typical_high;
  double value = low > 0 ? low * std::pow(high / low, position) : low + (high - low) * position;
  if (spec->kind == ParameterKind::integer) value = std::round(value);
  return value;
}

EffectCatalogue::EffectCatalogue(std::vector<const EffectDeclaration*> declarations)
    : declarations_(std::move(declarations)) {
  std::sort(declarations_.begin(), declarations_.end(),
            [](const EffectDeclaration* a, const EffectDeclaration* b) { return a->name < b->name; });
}

const EffectDeclaration* EffectCatalogue::find(const std::string& name) const {
  for (const EffectDeclaration* declaration : declarations_) {
    if (declaration->name == name) return declaration;
  }
  return nullptr;
}

std::vector<std::string> EffectCatalogue::names() const {
  std::vector<std::string> list;
  for (const EffectDeclaration* declaration : declarations_) list.push_back(declaration->name);
  return list;
}

}  // namespace binrig
