// From evidence to a verdict: one pure function, so that the order of the checks, which is what protects the user from
// a confident wrong name, stands in one place and is tested without any simulation.
#pragma once

#include <string>
#include <vector>

namespace binrig {

enum class Verdict { nothing_missing, missing_effect, confounded, unknown_effect, not_enough_data };
const char* verdict_name(Verdict verdict);

struct Evidence {
  /// Capture kinds that are lacking for any verdict at all ("a second capture to hold out").
  std::vector<std::string> lacking;
  /// Effects that were added, significant on train and confirmed on test, in order.
  struct Accepted {
    std::string effect;
    bool map = false;                 ///< declared as a per-unit map, which fits anything static
    bool map_looks_random = true;     ///< stationary and Gaussian (masks: spatially random)
    std::vector<std::string> rivals;  ///< that the data cannot tell from it
    /// Captures contradict each other about it, or its strength may as well be nothing: what helped is something else.
    bool doubtful = false;
  };
  std::vector<Accepted> accepted;
  /// Segments whose residual is beyond what the fitted model's own randomness explains, after all known effects are in.
  std::vector<std::string> unexplained_segments;
  /// A covariate explains part of the remainder on held-out captures beyond chance.
  bool screen_finds_something = false;
};

/// not_enough_data before all; then unknown_effect where anything stays unexplained (a catalogue name is then only the
/// nearest), an accepted map has a shape or an accepted effect is doubtful; then nothing_missing, confounded,
/// missing_effect.
Verdict judge(const Evidence& evidence);

}  // namespace binrig
