// diagnosis.json and ladder.json.
#include <cmath>

#include <nlohmann/json.hpp>

#include "diagnose/diagnose.h"

namespace binrig {
namespace {

using nlohmann::json;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

json score_json(const Score& score) {
  json out;
  out["unit"] = "mean square of the whitened held-out residual, less that of the last model's own simulations, plus 1";
  out["heldout"] = number(score.heldout);
  out["floor"] = 1.0;
  out["band"] = {number(score.band_low), number(score.band_high)};
  out["proper"] = number(score.proper);
  out["by_channel"] = json::object();
  for (const auto& [channel, value] : score.by_channel) out["by_channel"][channel] = number(value);
  out["by_segment"] = json::object();
  for (const auto& [segment, value] : score.by_segment) out["by_segment"][segment] = number(value);
  out["bias_rms_mm"] = number(score.bias_rms_mm);
  out["noise_ratio"] = number(score.noise_ratio);
  out["mask_difference"] = number(score.mask_difference);
  return out;
}

}  // namespace

std::string diagnosis_json(const Diagnosis& diagnosis) {
  json out;
  out["verdict"] = verdict_name(diagnosis.verdict);
  out["headline"] = diagnosis.headline;
  out["reasons"] = diagnosis.reasons;
  if (!diagnosis.ladder.empty()) out["score"] = score_json(diagnosis.ladder.front().score);
  out["courses"] = json::array();
  for (const Course& course : diagnosis.courses) {
    json entry = {{"segment", course.segment},
                  {"over", course.covariate},
                  {"over_unit", course.covariate_label},
                  {"unit", course.label},
                  {"even", course.even}};
    const std::pair<const char*, const std::vector<double>*> columns[] = {{"at", &course.at},
                                                                          {"model_given", &course.before},
                                                                          {"last_model", &course.after},
                                                                          {"low", &course.low},
                                                                          {"high", &course.high}};
    for (const auto& [name, values] : columns) {
      entry[name] = json::array();
      for (const double value : *values) entry[name].push_back(number(value));
    }
    out["courses"].push_back(std::move(entry));
  }
  out["candidates"] = json::array();
  for (const auto& candidate : diagnosis.candidates) {
    json entry;
    entry["effect"] = candidate.effect;
    entry["p_value"] = number(candidate.p.p);
    entry["p_extrapolated"] = candidate.p.extrapolated;
    entry["null_n"] = candidate.null_count;
    entry["evidence"] = number(candidate.evidence);
    entry["heldout_after"] = number(candidate.heldout_after);
    entry["parameters"] = json::object();
    for (const auto& [parameter, value] : candidate.parameters) {
      json p = {{"value", number(value.value)}, {"unit", parameter.unit}};
      if (value.ci95) p["ci95"] = {number((*value.ci95)[0]), number((*value.ci95)[1])};
      entry["parameters"][parameter.name] = p;
    }
    entry["differs_between_captures"] = candidate.differs;
    entry["may_be_nothing"] = candidate.may_be_nothing;
    entry["read_off_the_values"] = candidate.read_off;
    entry["confounded_with"] = candidate.confounded_with;
    if (candidate.sought_captures) {
      auto& captures = entry["captures_that_would_separate"] = nlohmann::json::array();
      for (const AdvisedCapture& advised : candidate.would_separate) captures.push_back(advised.where_to);
    }
    out["candidates"].push_back(entry);
  }
  out["as_many_as_allowed"] = diagnosis.as_many_as_allowed;
  out["unconfirmed"] = json::array();
  for (const auto& entry : diagnosis.unconfirmed)
    out["unconfirmed"].push_back({{"effect", entry.effect}, {"capture", entry.capture}});
  out["untested"] = json::array();
  for (const auto& entry : diagnosis.untested)
    out["untested"].push_back({{"effect", entry.effect}, {"needs", entry.needs}});
  out["unexplained"] = json::array();
  for (const auto& entry : diagnosis.unexplained) {
    json u = {{"channel", entry.channel},       {"segment", entry.segment},     {"ratio", number(entry.ratio)},
              {"covariates", entry.covariates}, {"share", number(entry.share)}, {"shape", entry.shape}};
    if (!entry.formula.empty()) u["effect_yaml"] = entry.formula;
    out["unexplained"].push_back(u);
  }
  out["advice"] = diagnosis.advice;
  out["ranking"] = json::array();
  for (const auto& entry : diagnosis.ranking)
    out["ranking"].push_back({{"effect", entry.effect},
                              {"gain", number(entry.gain)},
                              {"price", number(entry.price)},
                              {"p_value", number(entry.p.p)},
                              {"p_extrapolated", entry.p.extrapolated}});
  out["present_parameters"] = json::array();
  for (const auto& entry : diagnosis.present)
    out["present_parameters"].push_back({{"effect", entry.id},
                                         {"parameter", entry.name},
                                         {"unit", entry.unit},
                                         {"given", number(entry.given)},
                                         {"value", number(entry.fitted)},
                                         {"ci95", {number(entry.low), number(entry.high)}},
                                         {"determined", entry.determined},
                                         {"changed", entry.changed},
                                         {"superfluous", entry.superfluous}});
  out["warnings"] = diagnosis.warnings;
  out["seconds"] = number(diagnosis.seconds);
  out["simulated_captures"] = diagnosis.simulations;
  return out.dump(1);
}

std::string ladder_json(const Diagnosis& diagnosis) {
  json out = json::array();
  for (const auto& step : diagnosis.ladder) {
    json entry = score_json(step.score);
    entry["step"] = step.step;
    entry["added"] = step.added.empty() ? json(nullptr) : json(step.added);
    if (!step.removed.empty()) entry["removed"] = step.removed;
    out.push_back(entry);
  }
  return out.dump(1);
}

}  // namespace binrig
