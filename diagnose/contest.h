// Which of the hypotheses that are worth it is added: those that come close are fitted with everything, too.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "diagnose/adding.h"
#include "diagnose/candidates.h"
#include "diagnose/search_result.h"
#include "diagnose/signatures.h"

namespace binrig {

/// The one that is added.
struct Chosen {
  const Refined* best;
  Rung rung;                     ///< with it
  std::set<std::string> beaten;  ///< effects that came close, but the data tell them from the best
};

class Contest {
 public:
  /// Keeps references.
  Contest(const Experiment& experiment, const Adding& adding, const Candidates& candidates,
          const SearchOptions& options)
      : experiment_(experiment), adding_(adding), candidates_(candidates), options_(options) {}

  /// Of `worthy` (not empty, best first), beside `rung`. The runner-up is tried, too, if it comes_close, or is_rival to
  /// one that leaves something: a model's bent parameters may have favoured the wrong one. So are more (at most three),
  /// as long as something stays unexplained, or they would be called confounded with one that was no favourite.
  /// Of two, `choose` (diagnose/choice.h) says which. `signatures`: of what the rung's model lacks. Throws what
  /// simulating throws.
  Chosen decide(const Rung& rung, const std::vector<const Refined*>& worthy, const std::vector<Signature>& signatures,
                const RungOptions& fit) const;

 private:
  Rung with_best(const Rung& rung, const Refined& best, const RungOptions& fit) const;
  void meet(Chosen& chosen, const Refined& runner_up, Rung with, const std::vector<Signature>& signatures) const;
  double left_for(const Refined& refined, const Rung& rung, const std::vector<Signature>& signatures) const;

  const Experiment& experiment_;
  const Adding& adding_;
  const Candidates& candidates_;
  const SearchOptions& options_;
};

}  // namespace binrig
