// binrig effects: the catalogue.
#include <cstdio>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "app/commands.h"
#include "app/effects_doc.h"
#include "core/error.h"
#include "sim/effect.h"

namespace binrig {
namespace {

using nlohmann::json;

json parameter_json(const ParameterSpec& spec) {
  json entry = {{"name", spec.name},
                {"unit", spec.unit},
                {"bounds", {spec.lower, spec.upper}},
                {"typical", {spec.typical_low, spec.typical_high}},
                {"either_sign", spec.either_sign},
                {"initial", spec.initial},
                {"log_scaled", spec.log_scaled},
                {"meaning", spec.meaning}};
  entry["neutral"] = spec.neutral ? json(*spec.neutral) : json(nullptr);
  return entry;
}

json effect_json(const EffectDeclaration& effect) {
  json entry = {{"name", effect.name},
                {"phenomenon", effect.phenomenon},
                {"stage", stage_name(effect.stage)},
                {"formula", effect.formula},
                {"citation", effect.citation},
                {"deviation", effect.deviation},
                {"amplitude", effect.amplitude},
                {"stronger_is_larger", effect.stronger_is_larger},
                {"needs", effect.needs.words()},
                {"realisation", effect.per_unit_map ? "map" : effect.per_capture_map ? "map of a capture" : "draw"},
                {"may_clear", effect.may_clear},
                {"revealed_by", effect.revealed_by}};
  if (effect.reason) entry["reason"] = reason_name(*effect.reason);
  entry["parameters"] = json::array();
  for (const ParameterSpec& spec : effect.parameters) entry["parameters"].push_back(parameter_json(spec));
  entry["options"] = json::array();
  for (const OptionSpec& option : effect.options) {
    entry["options"].push_back({{"name", option.name}, {"default", option.default_value}, {"choices", option.choices},
                                {"meaning", option.meaning}});
  }
  return entry;
}

void print_effect(const EffectDeclaration& effect) {
  fmt::print("{}  (stage {})\n  {}\n\n  formula      {}\n", effect.name, stage_name(effect.stage), effect.phenomenon,
             effect.formula);
  if (!effect.citation.empty()) fmt::print("  source       {}\n", effect.citation);
  if (!effect.deviation.empty()) fmt::print("  we deviate   {}\n", effect.deviation);
  if (effect.reason) fmt::print("  reason       {}\n", reason_name(*effect.reason));
  if (const auto needs = effect.needs.words(); !needs.empty()) fmt::print("  needs        {}\n", fmt::join(needs, ", "));
  fmt::print("  revealed by  {}\n", effect.revealed_by);
  if (!effect.parameters.empty()) fmt::print("\n  {:<20} {:>10}  {:<22} {:<6} meaning\n", "parameter", "initial", "bounds", "unit");
  for (const ParameterSpec& spec : effect.parameters) {
    fmt::print("  {:<20} {:>10.4g}  {:<22} {:<6} {}{}\n", spec.name, spec.initial,
               fmt::format("{:.4g} .. {:.4g}", spec.lower, spec.upper), spec.unit, spec.meaning,
               spec.name == effect.amplitude ? "  [how strong it is]" : "");
  }
  for (const OptionSpec& option : effect.options) {
    fmt::print("  {:<20} {:>10}  {:<22} {:<6} {}\n", option.name, option.default_value.empty() ? "-" : option.default_value,
               fmt::format("{}", fmt::join(option.choices, ", ")), "text", option.meaning);
  }
}

}  // namespace

void add_effects(CLI::App& app, int& /*status*/) {
  CLI::App* verb = app.add_subcommand("effects", "the catalogue of physical effects: what each is, its parameters, and what capture reveals it");
  auto name = std::make_shared<std::string>();
  auto as_json = std::make_shared<bool>(false);
  verb->add_option("name", *name, "one effect, in full");
  verb->add_flag("--json", *as_json, "as JSON");
  auto markdown = std::make_shared<std::string>();
  verb->add_option("--markdown", *markdown, "write the catalogue with pictures as effects.md into this folder");
  verb->callback([=] {
    if (!markdown->empty()) return write_effects_page(*markdown);
    const EffectCatalogue& catalogue = effect_catalogue();
    if (!name->empty() && !catalogue.find(*name)) {
      const std::string near = nearest_word(*name, catalogue.names());
      throw Error("there is no effect named " + *name + (near.empty() ? "" : ": did you mean " + near + "?"));
    }
    if (*as_json) {
      json list = json::array();
      for (const EffectDeclaration* effect : catalogue.all()) {
        if (name->empty() || effect->name == *name) list.push_back(effect_json(*effect));
      }
      fmt::print("{}\n", (name->empty() ? list : list[0]).dump(1));
    } else if (!name->empty()) {
      print_effect(*catalogue.find(*name));
    } else {
      for (const std::string& stage : stage_names()) {
        for (const EffectDeclaration* effect : catalogue.all()) {
          if (stage == stage_name(effect->stage)) fmt::print("{:<12} {:<22} {}\n", stage, effect->name, effect->phenomenon);
        }
      }
      fmt::print("\n{} effects. `binrig effects NAME` shows one in full.\n", catalogue.all().size());
    }
  });
}

}  // namespace binrig
