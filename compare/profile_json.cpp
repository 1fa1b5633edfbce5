#include <cmath>

#include <nlohmann/json.hpp>

#include "compare/noise_profile.h"

namespace binrig {

namespace {

using nlohmann::json;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

json estimate_json(const Estimate& e) {
  return {{"value", number(e.value)},
          {"standard_error", number(e.standard_error)},
          {"degrees_of_freedom", e.degrees_of_freedom}};
}

json optional_json(const std::optional<double>& value) { return value ? number(*value) : json(nullptr); }

}  // namespace

json test_json(const TestResult& test) {
  if (!test.done) return {{"hypothesis", test.name}, {"done", false}, {"why", test.method}};
  return {{"hypothesis", test.name},
          {"done", true},
          {"statistic", number(test.statistic)},
          {"threshold", number(test.threshold)},
          {"p_value", number(test.p_value)},
          {"degrees_of_freedom", test.degrees_of_freedom},
          {"effective_n", test.effective_n},
          {"level", test.level},
          {"rejected", test.rejected()},
          {"method", test.method}};
}

json profile_json(const NoiseProfile& p) {
  json spectrum = json::array();
  for (std::size_t i = 0; i < p.spectrum.frequency.size(); ++i) {
    spectrum.push_back({{"frequency_per_px", p.spectrum.frequency[i]},
                        {"density_mm2_px2", number(p.spectrum.density[i].value)},
                        {"standard_error", number(p.spectrum.density[i].standard_error)}});
  }
  return {{"name", p.name},
          {"frames", p.frames},
          {"distance_mm", p.distance_mm},
          {"noise_is", p.temporal ? "temporal" : "spatial residual of a single frame: upper bound of the noise"},
          {"sigma_mm", estimate_json(p.sigma_mm)},
          {"robust_sigma_mm", p.marginal.robust_sigma_mm},
          {"skewness", number(p.marginal.skewness)},
          {"excess_kurtosis", number(p.marginal.excess_kurtosis)},
          {"beyond_3_sigma", p.marginal.beyond_3_sigma},
          {"beyond_4_sigma", p.marginal.beyond_4_sigma},
          {"histogram", {{"edges_mm", p.marginal.edges_mm}, {"counts", p.marginal.counts}}},
          {"gaussian", test_json(p.gaussian)},
          {"white", test_json(p.white)},
          {"correlation_length_px", estimate_json(p.correlation_length_px)},
          {"autocorrelation_over_px", p.autocorrelation},
          {"spectrum", spectrum},
          {"row_noise", {{"sigma_mm", p.lines.row_sigma_mm()}, {"test", test_json(p.lines.no_row_noise)}}},
          {"column_noise", {{"sigma_mm", p.lines.column_sigma_mm()}, {"test", test_json(p.lines.no_column_noise)}}},
          {"time",
           {{"lag1_correlation", estimate_json(p.time.lag1_correlation)},
            {"variogram_mm2", p.time.variogram_mm2},
            {"repeated_share", p.time.repeated_share},
            {"plane_offset_sigma_mm", p.time.offset_sigma_mm},
            {"plane_tilt_x_sigma_mm", p.time.tilt_x_sigma_mm},
            {"plane_tilt_y_sigma_mm", p.time.tilt_y_sigma_mm},
            {"test", test_json(p.time.frames_independent)}}},
          {"emva_split", p.split.done ? json{{"temporal_mm", p.split.temporal_mm},
                                             {"spatial_mm", p.split.spatial_mm},
                                             {"row_mm", p.split.row_mm},
                                             {"column_mm", p.split.column_mm},
                                             {"pixel_mm", p.split.pixel_mm},
                                             {"temporal_row_mm", p.split.temporal_row_mm},
                                             {"temporal_column_mm", p.split.temporal_column_mm}}
                                      : json(nullptr)},
          {"plane_metrics",
           {{"fill_rate", p.metrics.fill_rate},
            {"z_accuracy_mm", optional_json(p.metrics.z_accuracy_mm)},
            {"plane_rms_mm", p.metrics.plane_rms_mm},
            {"subpixel_rms_px", optional_json(p.metrics.subpixel_rms_px)},
            {"temporal_noise_mm", optional_json(p.metrics.temporal_noise_mm)}}},
          {"quantisation",
           {{"found", p.quantisation.found},
            {"step_mm", p.quantisation.step_mm},
            {"grows_with_depth_to_the_power", p.quantisation.power},
            {"coherence", p.quantisation.coherence},
            {"p_value", p.quantisation.p_value},
            {"storage_step_mm", p.quantisation.storage_step_mm}}},
          {"stationarity",
           {{"test", test_json(p.stationarity.equal_everywhere)},
            {"scatter_of_ln_sigma", p.stationarity.scatter},
            {"goes_with", p.stationarity.covariate},
            {"explained", p.stationarity.explained}}},
          {"bias_sigma_mm", estimate_json(p.bias_sigma_mm)}};
}

}  // namespace binrig
