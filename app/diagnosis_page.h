// The page of a diagnosis or an improvement: the answer in words, the ladder, the evidence, what to do next.
#pragma once

#include <string>

#include "diagnose/diagnose.h"
#include "report/page.h"

namespace binrig {

/// Runs the diagnosis of a recording set against a model (nullptr-free: everything is opened here).
struct DiagnosisRun {
  std::string measured, model;
  int most_effects = 4;
  std::uint64_t seed = 1;
};
Diagnosis run_diagnosis(const DiagnosisRun& run);

/// report.html in the folder. Returns its path.
std::string write_diagnosis_page(const Diagnosis& diagnosis, const DiagnosisRun& run, const std::string& folder,
                                 bool improve);

/// The answer on a terminal, a few lines.
std::string diagnosis_words(const Diagnosis& diagnosis);

}  // namespace binrig
