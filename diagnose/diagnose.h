// The diagnosis: where a model fails on a recording set, which physical effect it lacks, or that it lacks nothing, or
// that what it lacks is none of those known.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "diagnose/advice.h"
#include "diagnose/search.h"
#include "diagnose/verdict.h"

namespace binrig {

struct DiagnosisOptions {
  int most_effects = 4;  ///< added one after another
  int simulations = 32;  ///< of each model, for its own randomness; half as many or 8 where it is far off anyhow
  std::uint64_t seed = 1;
  std::string provenance;  ///< written into the improved model: which recording, when
};

/// Score of a model on the held-out captures: mean square of the whitened residual, less that of the last model's own
/// simulations, plus 1. The unit is the last model's randomness and the segments' practical floors together; the last
/// model's own simulations score 1.
struct Score {
  double heldout = 0;
  double statistics = 0;               ///< the same without how far poses and intrinsics are from where they are stated
  double band_low = 0, band_high = 0;  ///< 95 % of the last model's own simulations
  double proper = 0;  ///< mean squared whitened residual plus mean ln variance, by the model's own spread
  std::map<std::string, double> by_channel;
  std::map<std::string, double> by_segment;
  /// In plain units: RMS of the bias maps with targets where the data want them, sd measured over simulated, mean
  /// difference of drop-out shares.
  double bias_rms_mm = 0, noise_ratio = 0, mask_difference = 0;
};

/// Measured against simulated, in plain units (`label` says which; `even` is where both agree), targets and lens where
/// the data want them: by the model given and by the last one.
struct Maps {
  std::string segment;
  std::string label;    ///< what is shown, with its unit
  std::string capture;  ///< as capture_name says it
  double even = 0;
  cv::Mat before, after;  ///< CV_32F, one value a cell of the map
  cv::Mat valid;          ///< CV_8U
};

/// The same over a covariate or a frequency, mean over the captures held out. Between `low` and `high` lie 95 % of the
/// last model's own simulations.
struct Course {
  std::string segment;
  std::string covariate;        ///< of covariates(), or "frequency"
  std::string label;            ///< what is shown, with its unit
  std::string covariate_label;  ///< the same of the covariate
  double even = 0;
  std::vector<double> at, before, after, low, high;  ///< one element a class, by rising covariate
};

struct LadderStep {
  int step = 0;
  std::string added;    ///< "" = the start, or a step back
  /// An effect that later ones made superfluous, or what the one added took the place of: one, or "a and b".
  std::string removed;
  SensorModel model;
  Score score;
  /// What changed, in words; `start` if nothing was added yet.
  std::string name(const std::string& start) const {
    if (!added.empty()) return removed.empty() ? added : added + " for " + removed;
    return removed.empty() ? start : "without " + removed;
  }
};

struct CandidateReport {
  std::string effect, id;
  PValue p;
  int null_count = 0;
  double evidence = 0;  ///< held-out gain of chi
  double train_gain = 0;
  double heldout_after = 0;
  std::vector<std::pair<FitParameter, ParameterValue>> parameters;
  std::vector<std::string> confounded_with;
  std::vector<AdvisedCapture> would_separate;  ///< that, simulated, tell it from those of told_from; best first
  std::vector<std::string> told_from;          ///< all of confounded_with, or one of them
  bool sought_captures = false;                ///< that would
  bool differs = false;         ///< captures contradict each other about it: it stands for something else
  bool may_be_nothing = false;  ///< the interval of its strength holds the value at which it does nothing
  bool doubtful() const { return differs || may_be_nothing; }
  bool read_off = false;  ///< a step whose value is that of the recorded values' own, whatever else is missing
};

/// An effect that explains much of the captures fitted to, but leaves no trace in those held out: no answer.
struct Unconfirmed {
  std::string effect;
  std::string capture;  ///< that shows it most
};

struct Unexplained {
  std::string channel, segment;
  double ratio = 1;  ///< mean square of the residual over that of the model's own simulations
  double share = 0;  ///< of the residual beyond the model's randomness that the covariates explain, held out
  std::vector<std::string> covariates;
  std::string shape;
  std::string formula;  ///< a ready-to-paste effect, or ""
};

/// A parameter that the model had from the start, fitted with everything else.
struct PresentParameter {
  std::string id, name, unit;
  double given = 0, fitted = 0, low = 0, high = 0;  ///< low .. high: 95 %
  bool determined = true;    ///< false: the recording says less about it than its declaration does
  bool changed = false;      ///< determined, and the value given is not among those that the recording allows
  bool superfluous = false;  ///< an effect's strength that may as well be nothing: the recording needs no such effect
};
std::vector<PresentParameter> present_parameters(const SensorModel& given, const Rung& last,
                                                 const EffectCatalogue& catalogue);

struct LinearRank {
  std::string effect;
  double gain = 0, price = 0;
  PValue p;
};

struct Diagnosis {
  Verdict verdict = Verdict::not_enough_data;
  std::string headline;
  std::vector<std::string> reasons;
  std::vector<CandidateReport> candidates;  ///< significant and confirmed, best first
  std::vector<LinearRank> ranking;          ///< all hypotheses at the start, by gain
  std::vector<PresentParameter> present;    ///< of the model given
  std::vector<Untested> untested;
  std::vector<Unconfirmed> unconfirmed;
  std::vector<Unexplained> unexplained;
  bool as_many_as_allowed = false;  ///< effects were added: beside them nothing was looked for
  std::vector<std::string> advice;
  std::vector<LadderStep> ladder;
  SensorModel improved;  ///< last model, with intervals and provenance
  std::vector<std::string> warnings;
  double seconds = 0;
  long simulations = 0;  ///< captures simulated, not taken from the cache

  std::vector<Maps> maps;       ///< of the captures that the model given fails most in, a few of a segment
  std::vector<Course> courses;  ///< over what the segment goes with most, a few of a segment
};

/// Reads frame i of capture c (index into forward.captures()), measured.
Diagnosis diagnose(const ForwardModel& forward, const Experiment::FrameReader& reader, const SensorModel& model,
                   SimulationCache& cache, const DiagnosisOptions& options);

/// Headline, reasons and advice from the rest. `lacking`: Evidence::lacking.
void put_into_words(Diagnosis& diagnosis, const EffectCatalogue& catalogue, const std::vector<std::string>& lacking);

/// diagnosis.json and ladder.json.
std::string diagnosis_json(const Diagnosis& diagnosis);
std::string ladder_json(const Diagnosis& diagnosis);

}  // namespace binrig
