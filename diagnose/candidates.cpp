#include "diagnose/candidates.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "diagnose/choice.h"
#include "diagnose/score.h"

namespace binrig {

constexpr std::size_t most_others = 3;
constexpr double worth_a_thought = 0.25;  // of the gain of what was accepted

CandidateReport Candidates::report_of(const Refined& refined, int null_count) const {
  CandidateReport report;
  report.effect = refined.effect;
  report.id = refined.id;
  report.p = refined.p;
  report.null_count = null_count;
  report.evidence = refined.test_gain;
  report.train_gain = refined.train_gain;
  report.read_off = refined.step_seen;
  return report;
}

Evidence::Accepted Candidates::accepted(const Refined& refined) const {
  return {refined.effect, hypothesis(refined).declaration->per_unit_map, refined.random_map, {}};
}

std::string Candidates::leave_trifles(const Rung& rung, std::vector<const Refined*>& worthy) const {
  const auto declaration = [&](const Refined* refined) -> const EffectDeclaration& {
    return *hypothesis(*refined).declaration;
  };
  const auto strength = [&](const Refined* refined) {
    return refined->model.find(refined->id)->value(declaration(refined).amplitude);
  };
  const auto trifling = [&](const Refined* refined) {
    return declaration(refined).parameter(declaration(refined).amplitude) &&
           hardly_there(declaration(refined), strength(refined));
  };
  const auto first = std::ranges::find_if(worthy, trifling);
  if (first == worthy.end() || !unexplained(experiment_.layout(), rung).empty()) return "";
  const ParameterSpec& spec = *declaration(*first).parameter(declaration(*first).amplitude);
  std::string said = fmt::format(
      "a trace of {} is there ({} {:.2g}{}), but less than half of what the weakest instruments show ({:.2g}), and "
      "without it nothing is unexplained: it was left out",
      (*first)->effect, spec.name, strength(*first), spec.unit == "1" ? "" : " " + spec.unit, spec.typical_low);
  std::erase_if(worthy, trifling);
  return said;
}

Found Candidates::of(const Refined& refined, const Rung& rung, const SearchResult& found,
                     const std::set<std::string>& beaten) const {
  Found result{refined, report_of(refined, static_cast<int>(rung.nulls.size())), accepted(refined), {}};
  auto& [copy, report, accepted, others] = result;
  for (const auto& rival : found.refined)
    if (rival.effect != refined.effect && !beaten.contains(rival.effect) &&
        rival.test_gain > options_.least_test_gain &&
        std::find(accepted.rivals.begin(), accepted.rivals.end(), rival.effect) == accepted.rivals.end() &&
        confounded(rung, refined, rival))
      accepted.rivals.push_back(rival.effect);
  for (const Refined& other : found.refined)
    if (other.effect != refined.effect && !other.held && !refined.held &&
        other.train_gain > worth_a_thought * refined.train_gain && moves_the_same(rung, refined, other) &&
        std::ranges::find(others, other.effect, &Refined::effect) == others.end())
      others.push_back(other);
  std::ranges::stable_sort(others, std::ranges::greater{}, &Refined::train_gain);
  if (others.size() > most_others) others.resize(most_others);
  report.confounded_with = accepted.rivals;
  if (accepted.rivals.empty()) return result;
  std::vector<LookAlike> rivals;
  for (const std::string& name : accepted.rivals) {
    const Refined& rival = *std::ranges::find(found.refined, name, &Refined::effect);
    rivals.push_back({rival.model, rival.id, rival.fit});
  }
  seek_captures(report, rung, {refined.model, refined.id, refined.fit}, rivals);
  return result;
}

void Candidates::seek_captures(CandidateReport& report, const Rung& rung, const LookAlike& best,
                               const std::vector<LookAlike>& rivals) const {
  constexpr std::size_t most = 3;
  report.sought_captures = true;
  const auto found = [&](const std::vector<std::string>& names, const std::vector<LookAlike>& against) {
    report.told_from = names;
    report.would_separate = captures_that_separate(experiment_, motions_, rung, best, against, seed_ * 3001);
    // Of each target the place that says most: together they say more than one in several places.
    std::set<int> named;
    std::erase_if(report.would_separate, [&](const AdvisedCapture& a) { return !named.insert(a.capture).second; });
    report.would_separate.resize(std::min(report.would_separate.size(), most));
    return !report.would_separate.empty();
  };
  if (found(report.confounded_with, rivals) || rivals.size() == 1) return;
  for (std::size_t k = 0; k < rivals.size(); ++k)
    if (found({report.confounded_with[k]}, {rivals[k]})) return;
}

const Hypothesis& Candidates::hypothesis(const Refined& refined) const {
  return *std::ranges::find(all_.tested, refined.effect, &Hypothesis::effect);
}

}  // namespace binrig
