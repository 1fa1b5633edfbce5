// Counting what the diagnosis answered.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "bench/hidden_effects/study.h"
#include "compare/probability.h"
#include "sim/effect.h"

namespace binrig::hidden {
namespace {

struct Share {
  int hits = 0, trials = 0;
  void count(bool hit) { hits += hit, ++trials; }
  nlohmann::json json() const {
    const auto [low, high] = exact_interval(hits, trials);
    return {{"hits", hits},
            {"of", trials},
            {"rate", trials ? hits / static_cast<double>(trials) : 0.0},
            {"ci95", {low, high}}};
  }
};

std::string first_name(const nlohmann::json& line) {
  if (!line["candidates"].empty()) return line["candidates"][0]["effect"];
  return line["verdict"] == "nothing_missing" ? "(nothing)" : "(" + line["verdict"].get<std::string>() + ")";
}

bool within_group(const nlohmann::json& line, const std::string& name) {
  if (line["candidates"].empty()) return false;
  const auto& first = line["candidates"][0];
  if (first["effect"] == name) return true;
  return std::any_of(first["confounded_with"].begin(), first["confounded_with"].end(),
                     [&](const auto& other) { return other == name; });
}

/// Does the interval of a value hold the truth? None if there is no interval.
std::optional<bool> holds(const ParameterSpec& spec, const nlohmann::json& number, double truth) {
  if (!number.contains("ci95")) return {};
  const double low = number["ci95"][0], high = number["ci95"][1];
  if (spec.kind == ParameterKind::phase)
    truth += 2 * std::numbers::pi * std::round((0.5 * (low + high) - truth) / (2 * std::numbers::pi));
  return low <= truth && truth <= high;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

}  // namespace

std::pair<int, int> intervals_held(const nlohmann::json& line) {
  std::pair<int, int> result{0, 0};
  for (const auto& candidate : line["candidates"]) {
    const std::string name = candidate["effect"];
    if (!candidate.contains("parameters") || !line["truth"].contains(name)) continue;
    const EffectDeclaration* effect = effect_catalogue().find(name);
    if (!effect) continue;
    for (const auto& [parameter, number] : candidate["parameters"].items())
      if (const auto inside = holds(*effect->parameter(parameter), number, line["truth"][name][parameter]))
        result.first += *inside, result.second += 1;
  }
  return result;
}

std::pair<double, double> exact_interval(int successes, int trials) {
  // Clopper and Pearson, Biometrika 26 (1934): quantiles of beta distributions, by bisection.
  const auto quantile = [](double p, double a, double b) {
    double low = 0, high = 1;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (beta_lower(middle, a, b) < p ? low : high) = middle;
    }
    return 0.5 * (low + high);
  };
  if (trials == 0) return {0, 1};
  return {successes == 0 ? 0 : quantile(0.025, successes, trials - successes + 1.0),
          successes == trials ? 1 : quantile(0.975, successes + 1.0, trials - successes)};
}

nlohmann::json summary_of(const std::vector<nlohmann::json>& lines) {
  std::map<std::string, Share> first, named, alone, detected, floor;
  Share alarms, false_unknown, no_trace_alarms, pairs, unknown, amplitude_covered, all_covered;
  std::map<std::string, std::map<std::string, int>> confusion;
  std::map<std::string, std::vector<double>> errors;
  std::vector<double> before, after, cpu;
  for (const auto& line : lines) {
    if (line.contains("error")) {
      confusion[line["key"]]["(error)"] += 1;
      continue;
    }
    cpu.push_back(line["cpu_s"]);
    const std::string kind = line["kind"], verdict = line["verdict"];
    const auto& ladder = line["ladder"];
    const auto has = [&](const std::string& name, std::size_t most) {
      for (std::size_t k = 0; k < std::min(most, line["candidates"].size()); ++k)
        if (line["candidates"][k]["effect"] == name) return true;
      return false;
    };
    const auto without_trace = [](const nlohmann::json& trace) { return trace == 0; };
    if (line.contains("trace") && std::any_of(line["trace"].begin(), line["trace"].end(), without_trace)) {
      // Of one effect nothing is left to find; of a pair, the other.
      if (kind == "one") no_trace_alarms.count(!line["candidates"].empty());
      confusion["no trace: " + line["key"].get<std::string>()][first_name(line)] += 1;
      continue;
    }
    if (kind == "none") {
      alarms.count(!line["candidates"].empty());
      false_unknown.count(verdict == "unknown_effect");
      confusion["(none)"][first_name(line)] += 1;
    } else if (kind == "outside") {
      unknown.count(verdict == "unknown_effect");
      confusion["outside: " + line["effects"][0].get<std::string>()][verdict] += 1;
    } else if (kind == "pair") {
      pairs.count(has(line["effects"][0], 3) && has(line["effects"][1], 3));
    } else {
      const std::string name = line["effects"][0], strength = line["strength"];
      first[strength].count(first_name(line) == name);
      named[strength].count(within_group(line, name));
      alone[strength].count(line["candidates"].size() == 1 && first_name(line) == name);
      detected[strength].count(verdict != "nothing_missing");
      confusion[strength + ": " + name][first_name(line)] += 1;
      for (const auto& candidate : line["candidates"]) {
        if (candidate["effect"] != name || !candidate.contains("parameters")) continue;
        const EffectDeclaration* effect = effect_catalogue().find(name);
        for (const auto& [parameter, number] : candidate["parameters"].items()) {
          const double truth = line["truth"][name][parameter], value = number["value"];
          const auto inside = holds(*effect->parameter(parameter), number, truth);
          if (inside) all_covered.count(*inside);
          if (parameter != effect->amplitude) continue;
          if (inside) amplitude_covered.count(*inside);
          errors[strength].push_back(std::abs(value - truth) / std::abs(truth));
        }
      }
    }
    if (!ladder.empty() && (kind == "one" || kind == "pair")) {
      before.push_back(ladder.front()["heldout"]);
      after.push_back(ladder.back()["heldout"]);
      floor[kind].count(after.back() < 1.15);
    }
  }
  nlohmann::json summary;
  for (const auto& [strength, share] : first) summary["right_first"][strength] = share.json();
  for (const auto& [strength, share] : named) summary["right_or_declared_confounded"][strength] = share.json();
  for (const auto& [strength, share] : alone) summary["right_and_nothing_else"][strength] = share.json();
  for (const auto& [strength, share] : detected) summary["something_noticed"][strength] = share.json();
  for (const auto& [kind, share] : floor) summary["heldout_within_15_percent_of_floor"][kind] = share.json();
  summary["none_hidden_alarms"] = alarms.json();
  summary["none_hidden_called_unknown"] = false_unknown.json();
  summary["no_trace_alarms"] = no_trace_alarms.json();
  summary["pairs_both_in_three_steps"] = pairs.json();
  summary["outside_called_unknown"] = unknown.json();
  summary["amplitude_ci95_covers"] = amplitude_covered.json();
  summary["all_parameters_ci95_cover"] = all_covered.json();
  for (const auto& [strength, values] : errors) summary["median_relative_amplitude_error"][strength] = median(values);
  summary["median_heldout"] = {{"before", median(before)}, {"after", median(after)}};
  double total = 0;
  for (double s : cpu) total += s;
  summary["cpu_s"] = {{"median", median(cpu)}, {"mean", cpu.empty() ? 0 : total / cpu.size()}, {"total", total}};
  summary["recordings"] = lines.size();
  summary["confusion"] = confusion;
  return summary;
}

std::string summary_text(const nlohmann::json& summary) {
  std::string text;
  const auto share = [](const nlohmann::json& s) {
    return fmt::format("{:>4} of {:<4} {:5.1f} %  ({:.1f} .. {:.1f})\n", s["hits"].get<int>(), s["of"].get<int>(),
                       100 * s["rate"].get<double>(), 100 * s["ci95"][0].get<double>(),
                       100 * s["ci95"][1].get<double>());
  };
  for (const auto& [key, value] : summary.items()) {
    if (key == "confusion") continue;
    if (!value.is_object()) {
      text += fmt::format("{:<44} {}\n", key, value.dump());
    } else if (value.contains("hits")) {
      if (value["of"] != 0) text += fmt::format("{:<44} {}", key, share(value));
    } else {
      for (const auto& [part, inner] : value.items())
        text += inner.is_object() ? fmt::format("{:<44} {}", key + " " + part, share(inner))
                                  : fmt::format("{:<44} {:.4g}\n", key + " " + part, inner.get<double>());
    }
  }
  text += "answers (hidden -> first name, recordings):\n";
  for (const auto& [truth, answers] : summary["confusion"].items()) {
    text += fmt::format("  {:<36}", truth);
    for (const auto& [answer, count] : answers.items()) text += fmt::format(" {} {}", answer, count.get<int>());
    text += "\n";
  }
  return text;
}

}  // namespace binrig::hidden
