// Do simulated frames look like measured ones? Aspect by aspect, with a number, an interval and a p-value.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "compare/noise_profile.h"

namespace binrig {

/// `differs` needs both: a difference beyond the tolerance and one that chance does not explain (p < 0.05,
/// Holm-corrected over everything asked in one comparison). Beyond the tolerance but explicable by chance is
/// `undecided`: more data would tell. Within the tolerance is `agrees`, even where the difference is certain.
enum class Agreement { agrees, differs, undecided };
const char* agreement_name(Agreement agreement);

/// One question, asked of one capture.
struct Aspect {
  std::string id;     ///< "noise_level": the key of limits and of the JSON
  std::string title;  ///< "noise level"
  std::string unit;   ///< of measured and simulated
  double measured = 0, simulated = 0;
  double effect = 0;        ///< the difference as it is judged, see `effect_unit`
  std::string effect_unit;  ///< "relative", "dB", "1"
  double tolerance = 0;     ///< |effect| up to which the aspect agrees
  double raw_p = 1;         ///< of this test alone
  double p_value = 1;       ///< Holm-corrected over the comparison; NaN = no test, the effect alone decides
  double degrees_of_freedom = 0;
  Agreement agreement = Agreement::undecided;
  std::string capture;
};

struct CaptureFidelity {
  std::string capture;  ///< key
  bool held_out = false;
  NoiseProfile measured, simulated;
  SpectrumComparison spectrum;
  TestResult distribution, shape;
  std::vector<Aspect> aspects;
};

struct Fidelity {
  std::vector<CaptureFidelity> captures;
  std::vector<Aspect> others;  ///< asked of captures that are no planes (compare/scene_fidelity.h)
  /// Each aspect over all captures: the median effect; differs where it differs in any capture.
  std::vector<Aspect> overall;
  Agreement verdict = Agreement::undecided;
  std::string headline;              ///< in words
  std::vector<std::string> reasons;  ///< one sentence an aspect that does not agree, and why where the data say it
};

/// Compares two profiles of one capture. p-values are not yet corrected.
CaptureFidelity compare_profiles(NoiseProfile measured, NoiseProfile simulated, const std::string& capture,
                                 bool held_out);

/// Corrects, judges and words.
Fidelity judge(std::vector<CaptureFidelity> captures, std::vector<Aspect> others = {});

/// Limits from a YAML file: aspect id -> largest |effect| accepted (the spectrum's: `spectrum_inside`, least share of
/// frequencies in the band). Returns one sentence for each limit that is not kept; empty = all kept. Throws Error for
/// unknown keys and for an aspect that was not asked.
std::vector<std::string> broken_limits(const Fidelity& fidelity, const std::map<std::string, double>& limits);

nlohmann::json fidelity_json(const Fidelity& fidelity);

}  // namespace binrig
