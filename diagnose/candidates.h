// What is said of a hypothesis that a search accepted: what looks the same, and what to capture to tell them apart.
#pragma once

#include <set>
#include <string>

#include "diagnose/advice.h"
#include "diagnose/diagnose.h"
#include "diagnose/search_result.h"
#include "diagnose/verdict.h"

namespace binrig {

struct Found {
  Refined refined;
  CandidateReport report;
  Evidence::Accepted accepted;
  std::vector<Refined> others;  ///< what explains a quarter as much of the same on train, at most three, best first
};

/// Makes a `Found` of what a search found.
class Candidates {
 public:
  /// Keeps references; `seed` keys the simulations of captures that would separate.
  Candidates(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Hypotheses& all,
             const SearchOptions& options, std::uint64_t seed)
      : experiment_(experiment), motions_(motions), all_(all), options_(options), seed_(seed) {}

  /// `refined`, of `found`, which was looked for beside `rung`. Rivals are what `confounded` says of the others;
  /// effects `beaten` are none. Throws what simulating throws.
  Found of(const Refined& refined, const Rung& rung, const SearchResult& found,
           const std::set<std::string>& beaten = {}) const;

  /// Its gains (of chi) and p-value, which is counted in `null_count` simulated recordings; no rivals, no parameters.
  CandidateReport report_of(const Refined& refined, int null_count) const;

  /// What the verdict is to know of it; no rivals.
  Evidence::Accepted accepted(const Refined& refined) const;

  /// Puts captures into `report` that would tell `best` from all `rivals` (of `report.confounded_with`, in this order)
  /// when recorded together, at most three of different targets; if there are none, those for one of the rivals. Throws
  /// what simulating throws.
  void seek_captures(CandidateReport& report, const Rung& rung, const LookAlike& best,
                     const std::vector<LookAlike>& rivals) const;

  /// The hypothesis that was refined.
  const Hypothesis& hypothesis(const Refined& refined) const;

  /// Takes out those that are no finding though chance does not explain them: where nothing is unexplained beside
  /// `rung`, one that is weaker than any real instrument shows it stands in for the details in which model and
  /// instrument differ. Says so; "" if all stay.
  std::string leave_trifles(const Rung& rung, std::vector<const Refined*>& worthy) const;

 private:
  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Hypotheses& all_;
  const SearchOptions& options_;
  const std::uint64_t seed_;
};

}  // namespace binrig
