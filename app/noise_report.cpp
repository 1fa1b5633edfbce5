#include "app/noise_report.h"

#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "report/page.h"

namespace binrig {

namespace {

constexpr double degrees = 180 / std::numbers::pi;

const NoiseJudgement* decisive(const NoiseFitReport& report) {
  for (const auto& j : report.judgements)
    if (j.nearest) return &j;
  return nullptr;
}

std::string headline(const NoiseFitReport& report) {
  const NoiseJudgement* j = decisive(report);
  if (j == nullptr) return "Nothing to judge the fit on.";
  const std::string where =
      fmt::format("{} ({:.0f} mm, {:.0f} deg)", j->capture, j->distance_mm, j->incidence_rad * degrees);
  if (j->in_sample)
    return fmt::format("No held-out capture: {} was fitted to, which proves nothing; there the model {}.", where,
                       j->passed() ? "agrees" : "does not agree");
  return j->passed() ? fmt::format("The noise model holds on the held-out capture {}.", where)
                     : fmt::format("The noise model does not hold on the held-out capture {}.", where);
}

std::vector<std::string> reasons(const NoiseJudgement& j) {
  std::vector<std::string> lines{
      fmt::format("standard deviation: simulated {:.3g} mm, measured {:.3g} mm ({:+.1f} %, bound 10 %)",
                  j.sigma_simulated_mm, j.sigma_measured_mm, 100 * (j.sigma_simulated_mm / j.sigma_measured_mm - 1)),
      fmt::format(
          "radial spectrum: {:.0f} % of the frequencies inside the 95 % prediction band of +-{:.1f} dB (bound 85 %; "
          "{:.0f} % counting errors of estimation alone)",
          100 * j.share_inside, j.band_db, 100 * j.share_inside_estimation),
      fmt::format("correlation length: simulated {:.2f} px, measured {:.2f} px ({:+.1f} %, bound 15 %)",
                  j.length_simulated_px, j.length_measured_px,
                  100 * (j.length_simulated_px / j.length_measured_px - 1)),
      fmt::format("white Gaussian noise instead: whiteness test p {}, {}", p_text(j.white_p),
                  j.strawman_fails ? "so it does not describe this sensor" : "not refuted here")};
  for (const auto& why : j.why) lines.push_back("why: " + why);
  return lines;
}

}  // namespace

nlohmann::json noise_report_json(const NoiseFitReport& report) {
  nlohmann::json json{{"set", report.set},
                      {"model", report.model_out},
                      {"spectrum", report.spectrum_file},
                      {"verdict", headline(report)},
                      {"fit", noise_json(report.fit)},
                      {"model_sigma_mm", report.model_sigma_mm},
                      {"correction",
                       {{"rounds", report.correction_rounds},
                        {"sigma_ratio", report.correction_sigma_ratio},
                        {"spectrum_db", report.correction_spectrum_db}}},
                      {"notes", report.notes}};
  for (const auto& c : report.train) json["train"].push_back(noise_json(c));
  for (const auto& c : report.test) json["test"].push_back(noise_json(c));
  for (const auto& j : report.judgements) json["judgements"].push_back(noise_json(j));
  return json;
}

std::string noise_report_text(const NoiseFitReport& report) {
  const FittedNoise& fit = report.fit;
  std::string text = headline(report) + "\n";
  if (const NoiseJudgement* j = decisive(report))
    for (const auto& line : reasons(*j)) text += "  " + line + "\n";
  text += fmt::format(
      "\nFitted ({}): sigma {:.4g} mm [{:.4g}, {:.4g}] at {:.0f} mm and {:.0f} deg, correlation length {:.2f} px\n",
      fit.temporal ? "temporal noise" : "single frames, an upper bound", fit.sigma_mm, fit.sigma_ci95[0],
      fit.sigma_ci95[1], fit.anchor_mm, fit.anchor_incidence_rad * degrees, fit.shape.correlation_length_px());
  text += fmt::format(
      "  parametric: L {:.2f} px [{:.2f}, {:.2f}], white share {:.2f} [{:.2f}, {:.2f}], misfit {:.1f} (1 = chance)\n",
      fit.parametric.correlation_length_px, fit.parametric.correlation_length_ci95[0],
      fit.parametric.correlation_length_ci95[1], fit.parametric.white_share, fit.parametric.white_share_ci95[0],
      fit.parametric.white_share_ci95[1], fit.parametric.misfit);
  text += "  low frequencies dropped: " + fit.low.reason + "\n";
  if (fit.law.fitted)
    text += fmt::format(
        "  over the captures: sigma ~ z^({:.2f} +- {:.2f}), incidence a = {:.2f} +- {:.2f}, scatter about it {:.0f} "
        "%\n",
        fit.law.exponent, fit.law.exponent_se, fit.law.incidence, fit.law.incidence_se, 100 * fit.law.scatter);
  text += fmt::format("  storage step {:.3g} mm: its rounding noise was taken out\n", fit.rounding_mm);
  if (report.correction_rounds > 0)
    text += fmt::format(
        "  effects after the noise change it: density corrected in {} round{} (sigma {:+.1f} %, spectrum {:.2f} "
        "dB off)\n",
        report.correction_rounds, report.correction_rounds == 1 ? "" : "s", 100 * (report.correction_sigma_ratio - 1),
        report.correction_spectrum_db);
  for (const auto& remark : fit.remarks) text += "  note: " + remark + "\n";

  text += "\ncapture     frames   z mm  deg  region px  fill  sigma mm  (temporal)  fixed mm  length px\n";
  for (const auto* list : {&report.train, &report.test})
    for (const auto& c : *list) {
      text += fmt::format("{:<11} {:>6} {:>6.1f} {:>4.0f} {:>10} {:>4.0f}%  {:>8.4f}  {:>10}  {:>8}  {:>9.2f}\n",
                          c.look.key, c.frames_used, c.look.plane.distance_mm, c.look.plane.incidence_rad * degrees,
                          c.look.plane.pixels, 100 * c.look.plane.fill_share, c.single.sigma_mm(),
                          c.temporal ? fmt::format("{:.4f}", c.temporal->sigma_mm()) : "-",
                          c.temporal ? fmt::format("{:.4f}", std::sqrt(std::max(0.0, c.fixed_variance_mm2))) : "-",
                          c.noise().correlation_length_px());
      for (const auto& remark : c.remarks)
        if (c.temporal) text += "            " + remark + "\n";
    }
  text += fmt::format("\n{}     z mm  deg   sigma sim/meas     in band  length sim/meas   white p\n",
                      report.test.empty() ? "fitted to   " : "held out    ");
  for (const auto& j : report.judgements)
    text += fmt::format(
        "{:<11}{} {:>6.1f} {:>4.0f}  {:>6.3f}/{:<6.3f} {:<3}  {:>4.0f} % {:<3} {:>5.2f}/{:<5.2f} {:<4} {}\n", j.capture,
        j.nearest ? "*" : " ", j.distance_mm, j.incidence_rad * degrees, j.sigma_simulated_mm, j.sigma_measured_mm,
        j.sigma_ok ? "ok" : "NO", 100 * j.share_inside, j.spectrum_ok ? "ok" : "NO", j.length_simulated_px,
        j.length_measured_px, j.length_ok ? "ok" : "NO", p_text(j.white_p));
  for (const auto& j : report.judgements)
    for (const auto& why : j.why) text += fmt::format("  {}: {}\n", j.capture, why);
  for (const auto& note : report.notes) text += note + "\n";
  text += fmt::format("\nmodel: {}\nspectrum: {}\n", report.model_out, report.spectrum_file);
  if (!report.page.empty()) text += "report: " + report.page + "\n";
  return text;
}

std::string write_noise_page(const NoiseFitReport& report, const std::string& folder) {
  const FittedNoise& fit = report.fit;
  Page page("Noise of a depth sensor", report.set);
  page.fact("model", report.model_out);
  page.fact("what was fitted", fit.temporal ? "temporal noise" : "single frames: an upper bound for the noise");
  page.fact("standard deviation",
            fmt::format("{:.4g} mm [{:.4g}, {:.4g}] at {:.0f} mm, {:.0f} deg", fit.sigma_mm, fit.sigma_ci95[0],
                        fit.sigma_ci95[1], fit.anchor_mm, fit.anchor_incidence_rad * degrees));
  const NoiseJudgement* best = decisive(report);
  page.verdict(best == nullptr || best->in_sample ? Mark::open
               : best->passed()                   ? Mark::good
                                                  : Mark::bad,
               headline(report), best == nullptr ? std::vector<std::string>{} : reasons(*best));
  if (best != nullptr) {
    page.section("Spectrum, measured and simulated");
    Plot plot;
    plot.name = "noise_spectrum";
    plot.title = best->capture;
    plot.alt = fmt::format("Radial noise spectra of {}: {:.0f} % of the measured frequencies lie in the band.",
                           best->capture, 100 * best->share_inside);
    plot.caption = fmt::format(
        "Radially averaged power spectral density on {}. Band: 95 % prediction for a new capture, "
        "pointwise.",
        best->capture);
    plot.x_label = "frequency (cycles/px)";
    plot.y_label = "density (mm^2 px^2)";
    plot.log_y = true;
    plot.bands.push_back({"95 % prediction", best->frequency, best->band_low, best->band_high, Ink::simulated});
    plot.curves.push_back({"measured", best->frequency, best->measured, Ink::measured, Stroke::line});
    plot.curves.push_back({"simulated", best->frequency, best->simulated, Ink::simulated, Stroke::dashed});
    page.figure(draw(plot));
  }
  page.section("Captures");
  Table table;
  table.columns = {"capture",
                   "frames",
                   "distance (mm)",
                   "incidence (deg)",
                   "sigma of a frame (mm)",
                   "temporal (mm)",
                   "correlation length (px)"};
  for (const auto* list : {&report.train, &report.test})
    for (const auto& c : *list)
      table.rows.push_back({c.look.key, c.frames_used, c.look.plane.distance_mm, c.look.plane.incidence_rad * degrees,
                            c.single.sigma_mm(), c.temporal ? TableCell(c.temporal->sigma_mm()) : TableCell("-"),
                            c.noise().correlation_length_px()});
  page.table(table);
  page.section("Judgement");
  Table judged;
  judged.columns = {"capture",
                    "distance (mm)",
                    "incidence (deg)",
                    "sigma simulated / measured (mm)",
                    "frequencies in band",
                    "length simulated / measured (px)",
                    "white: p"};
  const auto mark = [](bool ok) { return ok ? Mark::good : Mark::bad; };
  for (const auto& j : report.judgements)
    judged.rows.push_back(
        {j.capture + (j.nearest ? " (decides)" : ""),
         j.distance_mm,
         j.incidence_rad * degrees,
         {significant(j.sigma_simulated_mm) + " / " + significant(j.sigma_measured_mm), mark(j.sigma_ok)},
         {percent(j.share_inside), mark(j.spectrum_ok)},
         {significant(j.length_simulated_px) + " / " + significant(j.length_measured_px), mark(j.length_ok)},
         p_text(j.white_p)});
  judged.caption = "Bounds: standard deviation 10 %, 85 % of the frequencies, correlation length 15 %.";
  page.table(judged);
  std::vector<std::string> why;
  for (const auto& j : report.judgements)
    for (const auto& line : j.why) why.push_back(j.capture + ": " + line);
  if (!why.empty()) page.list(why);
  page.section("How it was fitted");
  page.text("Low frequencies dropped: " + fit.low.reason + ".");
  for (const auto& remark : fit.remarks) page.note(remark);
  for (const auto& note : report.notes) page.note(note);
  return page.write(folder);
}

}  // namespace binrig
