// What was hidden and what the diagnosis answered, recording by recording, as a page.
#include <algorithm>
#include <map>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "bench/hidden_effects/study.h"

namespace binrig::hidden {
namespace {

using Lines = std::vector<const nlohmann::json*>;

std::vector<std::string> names_in(const nlohmann::json& list) { return list.get<std::vector<std::string>>(); }

bool is_hidden(const nlohmann::json& line, const std::string& name) {
  const auto hidden = names_in(line["effects"]);
  return std::find(hidden.begin(), hidden.end(), name) != hidden.end();
}

/// Names in the order in which they were added, wrong ones in bold, with those that are said to be as good.
std::string answer_of(const nlohmann::json& line) {
  const std::string verdict = line["verdict"];
  std::string text;
  for (const auto& candidate : line["candidates"]) {
    const std::string name = candidate["effect"];
    text += fmt::format("{}{}", text.empty() ? "" : ", ", is_hidden(line, name) ? name : "**" + name + "**");
    if (const auto rivals = names_in(candidate["confounded_with"]); !rivals.empty())
      text += fmt::format(" (or {})", fmt::join(rivals, ", "));
  }
  if (text.empty()) return "`" + verdict + "`";
  return verdict == "missing_effect" || verdict == "confounded" ? text : text + "; `" + verdict + "`";
}

/// The same in few words where one effect was hidden and stands in the row's head already.
std::string answer_to_one(const nlohmann::json& line) {
  const auto& candidates = line["candidates"];
  const std::string hidden = line["effects"][0];
  if (candidates.empty() || candidates[0]["effect"] != hidden) return answer_of(line);
  std::string text = answer_of(line);
  text.replace(0, hidden.size(), "yes");
  return text;
}

std::string score_of(const nlohmann::json& line) {
  std::string text;
  for (const auto& step : line["ladder"])
    text += fmt::format("{}{:.3g}", text.empty() ? "" : ", ", step["heldout"].get<double>());
  return text;
}

std::string held_of(const nlohmann::json& line) {
  const auto [held, all] = intervals_held(line);
  return all > 0 ? fmt::format("{} of {}", held, all) : "-";
}

bool without_trace(const nlohmann::json& line) {
  return line.contains("trace") &&
         std::ranges::any_of(line["trace"], [](const nlohmann::json& trace) { return trace == 0; });
}

std::string remark_of(const nlohmann::json& line) { return without_trace(line) ? "; leaves no trace" : ""; }

}  // namespace

std::string table_of(const std::vector<nlohmann::json>& lines) {
  std::map<std::string, std::map<std::string, std::string>> ones;  // by effect and strength
  std::vector<std::string> strengths;
  std::string pairs, outsiders;
  Lines none;
  for (const nlohmann::json& line : lines) {
    if (line.contains("error")) continue;
    const std::string kind = line["kind"];
    if (kind == "none") none.push_back(&line);
    if (kind == "one") {
      std::string& cell = ones[line["effects"][0]][line["strength"]];
      if (!cell.empty()) cell += "<br>";
      cell += fmt::format("{}; {}; {}{}", answer_to_one(line), score_of(line), held_of(line), remark_of(line));
    } else if (kind == "pair") {
      pairs += fmt::format("| {} | {} | {} | {}{} |\n", fmt::join(names_in(line["effects"]), ", "), answer_of(line),
                           score_of(line), held_of(line), remark_of(line));
    } else if (kind == "outside") {
      outsiders +=
          fmt::format("| {} | {} | {} |\n", line["effects"][0].get<std::string>(), answer_of(line), score_of(line));
    }
  }
  std::string text;
  for (const char* strength : {"weak", "medium", "strong"})
    if (std::ranges::any_of(ones, [&](const auto& row) { return row.second.contains(strength); }))
      strengths.push_back(strength);
  if (!ones.empty()) {
    text += fmt::format("| hidden | {} |\n|---|", fmt::join(strengths, " | "));
    for (std::size_t k = 0; k < strengths.size(); ++k) text += "---|";
    text += "\n";
    for (auto& [effect, cells] : ones) {
      text += "| " + effect + " |";
      for (const std::string& strength : strengths) text += " " + cells[strength] + " |";
      text += "\n";
    }
    text += "\n";
  }
  if (!pairs.empty())
    text += "| two hidden | named | score, step by step | intervals held |\n|---|---|---|---|\n" + pairs + "\n";
  if (!outsiders.empty())
    text += "| in no catalogue | nearest names; verdict | score, step by step |\n|---|---|---|\n" + outsiders + "\n";
  if (!none.empty()) {
    const auto alarms = std::ranges::count_if(none, [](const auto* line) { return !(*line)["candidates"].empty(); });
    text += fmt::format("Nothing hidden: {} recordings, {} with a name.\n", none.size(), alarms);
  }
  return text;
}

}  // namespace binrig::hidden
