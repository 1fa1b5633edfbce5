#include "core/error.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>

namespace binrig {

std::string Violation::text() const {
  std::string line;
  if (!where.empty()) line += where + ": ";
  if (!key.empty()) line += key;
  if (!value.empty()) line += (key.empty() ? "" : " = ") + value;
  if (!value.empty() && !unit.empty() && unit != "1") line += " " + unit;
  if (!message.empty()) line += (key.empty() && value.empty() ? "" : " ") + message;
  if (!bounds.empty()) line += " (accepted: " + bounds + (unit.empty() || unit == "1" ? "" : " " + unit) + ")";
  return line;
}

namespace {
std::string full_text(const std::string& summary, const std::vector<Violation>& violations) {
  std::string text = summary;
  for (const Violation& violation : violations) text += "\n  " + violation.text();
  return text;
}
}  // namespace

Error::Error(const std::string& summary, std::vector<Violation> violations, ErrorKind kind)
    : std::runtime_error(full_text(summary, violations)), violations_(std::move(violations)), kind_(kind) {}

Error::Error(const std::string& summary, ErrorKind kind) : Error(summary, {}, kind) {}

void Violations::add(std::string where, std::string key, std::string message) {
  Violation violation;
  violation.where = std::move(where);
  violation.key = std::move(key);
  violation.message = std::move(message);
  list_.push_back(std::move(violation));
}

void Violations::add_all(const std::vector<Violation>& more) { list_.insert(list_.end(), more.begin(), more.end()); }

void Violations::throw_if_any(const std::string& summary) const {
  if (!list_.empty()) throw Error(summary, list_);
}

std::string number_text(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  return fmt::format("{}", value);
}

std::string nearest_word(const std::string& word, const std::vector<std::string>& candidates) {
  const std::size_t limit = std::max<std::size_t>(1, word.size() / 3);
  std::string best;
  std::size_t best_distance = limit + 1;
  for (const std::string& candidate : candidates) {
    // Rows of the edit distance, in which two neighbouring letters swapped count as one edit.
    std::vector<std::size_t> before, previous, row(candidate.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= word.size(); ++i) {
      before = previous;
      previous = row;
      row[0] = i;
      for (std::size_t j = 1; j <= candidate.size(); ++j) {
        row[j] = std::min({previous[j] + 1, row[j - 1] + 1, previous[j - 1] + (word[i - 1] != candidate[j - 1])});
        const bool swapped = i > 1 && j > 1 && word[i - 1] == candidate[j - 2] && word[i - 2] == candidate[j - 1];
        if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    if (row.back() < best_distance) {
      best_distance = row.back();
      best = candidate;
    }
  }
  return best;
}

}  // namespace binrig
