#include "diagnose/verdict.h"

#include <algorithm>

namespace binrig {

const char* verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::nothing_missing:
      return "nothing_missing";
    case Verdict::missing_effect:
      return "missing_effect";
    case Verdict::confounded:
      return "confounded";
    case Verdict::unknown_effect:
      return "unknown_effect";
    case Verdict::not_enough_data:
      return "not_enough_data";
  }
  return "";
}

Verdict judge(const Evidence& evidence) {
  if (!evidence.lacking.empty()) return Verdict::not_enough_data;
  if (!evidence.unexplained_segments.empty() || evidence.screen_finds_something) return Verdict::unknown_effect;
  const auto& accepted = evidence.accepted;
  if (std::any_of(accepted.begin(), accepted.end(),
                  [](const Evidence::Accepted& a) { return a.doubtful || (a.map && !a.map_looks_random); }))
    return Verdict::unknown_effect;
  if (accepted.empty()) return Verdict::nothing_missing;
  if (std::any_of(accepted.begin(), accepted.end(), [](const Evidence::Accepted& a) { return !a.rivals.empty(); }))
    return Verdict::confounded;
  return Verdict::missing_effect;
}

}  // namespace binrig
