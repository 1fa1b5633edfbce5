// The study: effects are hidden in recordings, the diagnosis is asked, and what it answers is counted.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "bench/hidden_effects/recording.h"
#include "diagnose/diagnose.h"

namespace binrig::hidden {

/// One recording to be made and diagnosed.
struct Case {
  std::string kind;  ///< one, none, pair, outside
  std::vector<std::string> effects;
  Strength strength = Strength::medium;
  std::uint64_t seed = 1;
  std::string key() const;
};

struct Plan {
  std::vector<std::string> effects;  ///< empty: the whole catalogue
  std::vector<Strength> strengths{Strength::medium};
  int first_seed = 1;
  int seeds = 1;  ///< of each effect and strength
  int none = 0, pairs = 0, outside = 0;  ///< pairs are of the first strength
};
/// Seed by seed, so that a part of the list says something about all effects. Throws Error if pairs are asked of one.
std::vector<Case> cases_of(const Plan& plan);

/// Everything about a recording but the answer: what is really there.
struct Truth {
  SensorModel instrument;       ///< with its five base effects
  std::vector<Offset> offsets;  ///< where the targets really stand
  SensorModel start;            ///< the model that the diagnosis begins with: five effects, less those hidden
  std::vector<HiddenEffect> hidden;
  bench::Recording recording;
  std::uint64_t frames_seed = 0;  ///< of `recording`
};
Truth make_truth(const SceneForwardModel& forward, const Case& c);

/// Of each hidden effect the share of all pixels of all frames whose stored depth would be another one without it, in
/// the order of `hidden`. With 0 nothing that is recorded tells of it: a threshold that no target comes near.
std::vector<double> traces_of(const SceneForwardModel& forward, const Truth& truth);

Diagnosis ask(const SceneForwardModel& forward, const Truth& truth, SimulationCache& cache,
              const DiagnosisOptions& options);

/// How far the hidden recording is from what the catalogue makes of the very same instrument and registration: mean
/// square by segment in units of the catalogue's own randomness (1 = the two implementations agree).
std::map<std::string, double> disagreement(const SceneForwardModel& forward, const Truth& truth, SimulationCache& cache,
                                           int simulations = 8);

/// The lines of a study's file; none if there is no such file. The last one may be cut off, and is then left out.
std::vector<nlohmann::json> read_lines(const std::string& path);

/// One line of the study's file. `traces` as of traces_of.
nlohmann::json line_of(const Case& c, const Truth& truth, const std::vector<double>& traces, const Diagnosis& diagnosis,
                       double cpu_s);

/// Confusion matrix, rates with exact (Clopper-Pearson) 95 % intervals, errors, coverage, times. What leaves no trace
/// cannot be found: recordings with it count for times and in the matrix only, and if nothing else was hidden, any name
/// is an alarm (`no_trace_alarms`).
nlohmann::json summary_of(const std::vector<nlohmann::json>& lines);
std::string summary_text(const nlohmann::json& summary);

/// Every answer as Markdown: one row an effect with a cell a strength (names in order, wrong ones in bold; the held-out
/// score step by step; how many intervals held), then pairs, effects of no catalogue, and recordings with nothing
/// hidden.
std::string table_of(const std::vector<nlohmann::json>& lines);

/// How many of the 95 % intervals that were given for hidden effects hold the truth, and how many were given. Phases
/// are what they are modulo 2 pi.
std::pair<int, int> intervals_held(const nlohmann::json& line);

/// Exact two-sided 95 % interval of a share.
std::pair<double, double> exact_interval(int successes, int trials);

std::string strength_name(Strength strength);

}  // namespace binrig::hidden
