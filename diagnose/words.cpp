// The verdict in words that need no manual.
#include <algorithm>

#include <fmt/format.h>

#include "diagnose/diagnose.h"

namespace binrig {
namespace {

std::string list(const std::vector<std::string>& names) {
  if (names.empty()) return "";
  if (names.size() == 1) return names[0];
  return fmt::format("{} and {}", fmt::join(names.begin(), names.end() - 1, ", "), names.back());
}

/// Two digits, never as a power of ten.
std::string times(double ratio) { return ratio < 10 ? fmt::format("{:.2g}", ratio) : fmt::format("{:.0f}", ratio); }

std::string fall(const Diagnosis& diagnosis) {
  if (diagnosis.ladder.size() < 2) return "";
  const Score &before = diagnosis.ladder.front().score, &after = diagnosis.ladder.back().score;
  const char* them = diagnosis.ladder.size() == 2 ? "it" : "them";
  const std::string from = times(before.heldout), to = times(after.heldout);
  std::string text =
      after.heldout < before.heldout && from != to
          ? fmt::format("adding {} takes the error on captures held out from {} to {} (the floor is 1)", them, from, to)
          : fmt::format(
                "with {} the recording is likelier, but the error on captures held out stays where it was "
                "({:#.3g}, then {:#.3g}; the floor is 1)",
                them, before.heldout, after.heldout);
  if (after.bias_rms_mm < 0.7 * before.bias_rms_mm)
    text += fmt::format(", their mean depth error from {:.2g} to {:.2g} mm", before.bias_rms_mm, after.bias_rms_mm);
  return text;
}

/// Effects of no catalogue were mimicked up to three quarters by what the catalogue has.
constexpr double most_of_it = 0.8;

/// The share of the held-out error above the floor that the ladder takes away.
double share_explained(const Diagnosis& diagnosis) {
  if (diagnosis.ladder.size() < 2) return 0;
  const double before = diagnosis.ladder.front().score.heldout, after = diagnosis.ladder.back().score.heldout;
  return before > 1 ? (before - after) / (before - 1) : 0;
}

}  // namespace

void put_into_words(Diagnosis& diagnosis, const EffectCatalogue& catalogue, const std::vector<std::string>& lacking) {
  std::vector<std::string> names, segments;
  for (const auto& candidate : diagnosis.candidates) names.push_back(candidate.effect);
  for (const auto& entry : diagnosis.unexplained) segments.push_back(entry.segment);
  const auto describe = [&](const std::string& name) {
    if (const auto* effect = catalogue.find(name))
      diagnosis.reasons.push_back(fmt::format("{}: {}", name, effect->phenomenon));
  };
  switch (diagnosis.verdict) {
    case Verdict::nothing_missing:
      diagnosis.headline = "Nothing is missing: the model explains this recording within its own randomness.";
      break;
    case Verdict::missing_effect:
      diagnosis.headline = fmt::format("The model lacks {}: {}.", list(names), fall(diagnosis));
      break;
    case Verdict::confounded:
      diagnosis.headline = fmt::format("Something is missing, and it is {}, or what cannot be told from it here: {}.",
                                       list(names), fall(diagnosis));
      break;
    case Verdict::unknown_effect: {
      const std::string where = segments.empty() ? "" : "; it shows in " + list(segments);
      const bool looked = names.empty() || !diagnosis.as_many_as_allowed;
      std::vector<std::string> firm;
      for (const auto& candidate : diagnosis.candidates)
        if (!candidate.doubtful()) firm.push_back(candidate.effect);
      if (!firm.empty() && share_explained(diagnosis) > most_of_it) {
        diagnosis.headline = fmt::format(
            "Most of what is missing looks like {}: {}. {}{}.", list(firm), fall(diagnosis),
            looked ? "What is left no known effect explains" : "Something is left, and no others were to be added",
            where);
        for (const auto& name : firm) describe(name);
        diagnosis.reasons.push_back(fmt::format(
            "Whatever the rest is may have bent the values found for {}, beyond their intervals.", list(firm)));
      } else {
        diagnosis.headline =
            !looked ? fmt::format("More is missing than {}, and no others were to be added{}.", list(names), where)
            : segments.empty() && !names.empty()
                ? "Something is missing, and this recording does not show what: see what speaks against the nearest."
                : fmt::format("Something is missing that no known effect explains{}.", where);
        if (!names.empty())
          diagnosis.reasons.push_back(fmt::format("The nearest known {} {}: {}. Do not take {} for the cause.",
                                                  names.size() == 1 ? "effect is" : "effects are", list(names),
                                                  fall(diagnosis), names.size() == 1 ? "it" : "them"));
      }
      for (const auto& candidate : diagnosis.candidates) {
        if (candidate.differs)
          diagnosis.reasons.push_back(fmt::format(
              "{}: captures contradict each other about it, each wants it stronger or weaker, shifted or wider than "
              "the others do: it stands for something else.",
              candidate.effect));
        else if (candidate.may_be_nothing)
          diagnosis.reasons.push_back(fmt::format(
              "{}: was added, but its strength may as well be nothing: it is what was fitted with it that helped.",
              candidate.effect));
      }
      break;
    }
    case Verdict::not_enough_data:
      diagnosis.headline = "This recording cannot answer the question.";
      for (const auto& item : lacking) diagnosis.reasons.push_back("It lacks " + item + ".");
      return;
  }
  if (diagnosis.verdict == Verdict::missing_effect || diagnosis.verdict == Verdict::confounded)
    for (const auto& candidate : diagnosis.candidates) {
      describe(candidate.effect);
      if (candidate.confounded_with.empty()) continue;
      std::vector<std::string> captures;
      for (const auto& name : {candidate.effect, candidate.confounded_with.front()})
        if (const auto* effect = catalogue.find(name); effect && !effect->revealed_by.empty())
          captures.push_back(fmt::format("{} (shows {})", effect->revealed_by, name));
      std::string text =
          fmt::format("{} and {} look the same in these captures", candidate.effect, list(candidate.confounded_with));
      std::vector<std::string> advised;
      for (const AdvisedCapture& capture : candidate.would_separate) advised.push_back(capture.where_to);
      if (!advised.empty())
        text += fmt::format("; simulated with either, {} would tell {} from {}: {}",
                            advised.size() == 1 ? "one more capture like this" : "more captures like these, together,",
                            candidate.effect, list(candidate.told_from), fmt::join(advised, ", "));
      else if (candidate.sought_captures)
        text += fmt::format(
            "; simulated with either, none of them nearer, further away or tilted would tell {} from {}; "
            "to tell them apart, if anything does, record {}",
            candidate.effect, list(candidate.told_from), list(captures));
      else
        text += "; to tell them apart, record " + list(captures);
      diagnosis.advice.push_back(text);
    }
  for (const auto& candidate : diagnosis.candidates) {
    const auto* effect = catalogue.find(candidate.effect);
    if (!effect || !candidate.read_off) continue;
    for (const auto& [parameter, value] : candidate.parameters)
      if (parameter.name == effect->amplitude)
        diagnosis.reasons.push_back(
            fmt::format("{}: the recorded values themselves come in steps of {:.4g} {}, whatever else is missing.",
                        candidate.effect, value.value, parameter.unit));
  }
  for (const auto& [effect, capture] : diagnosis.unconfirmed)
    diagnosis.advice.push_back(fmt::format(
        "{} would explain much of {}, but no capture held out shows it, so that nothing confirms it: record "
        "another such target, at another place, in the split test",
        effect, capture));
  for (const auto& entry : diagnosis.unexplained) {
    std::string text =
        fmt::format("{}: {} times what the model's own randomness explains", entry.segment, times(entry.ratio));
    if (!entry.covariates.empty())
      text += fmt::format("; it goes with {} ({:.0f} % of it)", list(entry.covariates), 100 * entry.share);
    if (!entry.shape.empty()) text += "; " + entry.shape;
    diagnosis.reasons.push_back(text + ".");
  }
  std::vector<std::string> superfluous;
  for (const auto& entry : diagnosis.present)
    if (entry.superfluous) superfluous.push_back(entry.id);
  if (!superfluous.empty())
    diagnosis.reasons.push_back(
        fmt::format("The model has more than this recording needs: {} may as well be absent.", list(superfluous)));
  if (!diagnosis.untested.empty()) {
    std::vector<std::string> some;
    for (const auto& entry : diagnosis.untested) some.push_back(entry.effect);
    diagnosis.reasons.push_back(fmt::format("Not tested, because this recording cannot show them: {}.", list(some)));
  }
}

}  // namespace binrig
