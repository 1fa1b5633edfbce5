// JSON of calib/noise_fit.h.
#include <algorithm>
#include <numbers>

#include <nlohmann/json.hpp>

#include "calib/noise_fit.h"

namespace binrig {

namespace {

constexpr double degrees = 180 / std::numbers::pi;

nlohmann::json estimate_json(const SpectrumEstimate& e) {
  const RadialDensity radial = e.radial(std::clamp(static_cast<int>(e.max_lag_px / 2.5), 4, 32));
  return {{"sigma_mm", e.sigma_mm()},
          {"correlation_length_px", e.correlation_length_px()},
          {"frames", e.frames},
          {"max_lag_px", e.max_lag_px},
          {"drop_order", e.drop_order},
          {"effective_pixels", e.effective_pixels()},
          {"radial", {{"frequency_per_px", radial.frequency}, {"density_mm2_px2", radial.density}, {"sd", radial.sd}}}};
}

}  // namespace

nlohmann::json noise_json(const CaptureNoise& noise) {
  const PlaneFit& plane = noise.look.plane;
  nlohmann::json json{{"capture", noise.look.key},
                      {"name", noise.look.name},
                      {"frames", noise.frames_used},
                      {"plane",
                       {{"distance_mm", plane.distance_mm},
                        {"incidence_deg", plane.incidence_rad * degrees},
                        {"normal", {plane.normal.x(), plane.normal.y(), plane.normal.z()}},
                        {"offset_mm", plane.offset_mm},
                        {"region", noise.look.region_given ? "given" : "found"},
                        {"pixels", plane.pixels},
                        {"fill_share", plane.fill_share},
                        {"inlier_share", plane.inlier_share},
                        {"rms_z_mm", plane.rms_z_mm},
                        {"rms_orthogonal_mm", plane.rms_orthogonal_mm}}},
                      {"step_mm", noise.step_mm},
                      {"repeated_share", noise.repeated_share},
                      {"stationarity",
                       {{"cell_px", noise.stationarity.cell_px},
                        {"scatter", noise.stationarity.scatter},
                        {"covariate", noise.stationarity.covariate},
                        {"explained", noise.stationarity.explained},
                        {"p_value", noise.stationarity.equal_everywhere.p_value}}},
                      {"single_frames", estimate_json(noise.single)},
                      {"remarks", noise.remarks}};
  if (noise.temporal) {
    json["temporal"] = estimate_json(*noise.temporal);
    json["fixed_variance_mm2"] = noise.fixed_variance_mm2;
  }
  if (noise.memory) json["memory"] = *noise.memory;
  return json;
}

nlohmann::json noise_json(const FittedNoise& fit) {
  return {{"kind", fit.temporal ? "temporal noise" : "single frames: an upper bound for the noise"},
          {"captures", fit.captures},
          {"sigma_mm", fit.sigma_mm},
          {"sigma_ci95_mm", fit.sigma_ci95},
          {"at_distance_mm", fit.anchor_mm},
          {"at_incidence_deg", fit.anchor_incidence_rad * degrees},
          {"rounding_mm", fit.rounding_mm},
          {"correlation_length_px", fit.shape.correlation_length_px()},
          {"between_captures", fit.between_captures},
          {"length_slope_per_rad", fit.length_slope},
          {"length_slope_se", fit.length_slope_se},
          {"low_frequencies",
           {{"drop_order", fit.low.drop_order},
            {"plateau_found", fit.low.plateau_found},
            {"order", fit.low.order},
            {"ratio", fit.low.ratio},
            {"p_value", fit.low.p_value},
            {"reason", fit.low.reason}}},
          {"law",
           {{"fitted", fit.law.fitted},
            {"reference_mm", fit.law.reference_mm},
            {"sigma0_mm", fit.law.sigma0_mm},
            {"exponent", fit.law.exponent},
            {"exponent_se", fit.law.exponent_se},
            {"incidence", fit.law.incidence},
            {"incidence_se", fit.law.incidence_se},
            {"scatter", fit.law.scatter}}},
          {"parametric",
           {{"correlation_length_px", fit.parametric.correlation_length_px},
            {"correlation_length_ci95", fit.parametric.correlation_length_ci95},
            {"white_share", fit.parametric.white_share},
            {"white_share_ci95", fit.parametric.white_share_ci95},
            {"misfit", fit.parametric.misfit}}},
          {"remarks", fit.remarks}};
}

nlohmann::json noise_json(const NoiseJudgement& j) {
  return {{"capture", j.capture},
          {"name", j.name},
          {"in_sample", j.in_sample},
          {"nearest", j.nearest},
          {"passed", j.passed()},
          {"distance_mm", j.distance_mm},
          {"incidence_deg", j.incidence_rad * degrees},
          {"sigma_mm", {{"measured", j.sigma_measured_mm}, {"simulated", j.sigma_simulated_mm}, {"ok", j.sigma_ok}}},
          {"correlation_length_px",
           {{"measured", j.length_measured_px}, {"simulated", j.length_simulated_px}, {"ok", j.length_ok}}},
          {"spectrum",
           {{"share_inside", j.share_inside},
            {"share_inside_estimation_only", j.share_inside_estimation},
            {"band_half_width_db", j.band_db},
            {"ok", j.spectrum_ok},
            {"frequency_per_px", j.frequency},
            {"measured_mm2_px2", j.measured},
            {"simulated_mm2_px2", j.simulated},
            {"band_low", j.band_low},
            {"band_high", j.band_high}}},
          {"strawman", {{"white_p", j.white_p}, {"statistic", j.white_statistic}, {"fails", j.strawman_fails}}},
          {"why", j.why}};
}

}  // namespace binrig
