// What fit-noise found: as text, JSON and a page.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calib/noise_fit.h"

namespace binrig {

struct NoiseFitReport {
  std::string set, model_out, spectrum_file, page;
  LowFrequencies low;
  FittedNoise fit;
  std::vector<CaptureNoise> train, test;
  std::vector<NoiseJudgement> judgements;
  double model_sigma_mm = 0;  ///< the parameter as written, before later effects act on it
  int correction_rounds = 0;  ///< of the density, for effects that act after the noise
  double correction_sigma_ratio = 1, correction_spectrum_db = 0;
  std::vector<std::string> notes;
};

std::string noise_report_text(const NoiseFitReport& report);
nlohmann::json noise_report_json(const NoiseFitReport& report);
/// Writes FOLDER/report.html; returns its path.
std::string write_noise_page(const NoiseFitReport& report, const std::string& folder);

}  // namespace binrig
