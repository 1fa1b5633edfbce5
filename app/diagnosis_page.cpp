#include "app/diagnosis_page.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include <fmt/format.h>

#include "app/forward.h"
#include "sim/effect.h"

namespace binrig {
namespace {

std::string parameter_text(const CandidateReport& candidate) {
  std::vector<std::string> parts;
  for (const auto& [parameter, value] : candidate.parameters) {
    std::string text = parameter.name + " " + significant(value.value);
    if (parameter.unit != "1") text += " " + parameter.unit;
    if (value.ci95) text += fmt::format(" ({} .. {})", significant((*value.ci95)[0]), significant((*value.ci95)[1]));
    parts.push_back(text);
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::string p_cell(const PValue& p, int null_count) {
  return p_text(p.p) + (p.extrapolated ? fmt::format(" (tail beyond {} simulations)", null_count) : "");
}

Mark mark_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::nothing_missing:
      return Mark::good;
    case Verdict::missing_effect:
    case Verdict::unknown_effect:
      return Mark::bad;
    default:
      return Mark::open;
  }
}

void ladder_section(Page& page, const Diagnosis& diagnosis) {
  page.section("The ladder");
  page.text(
      "How far each model is from captures that it was not fitted to. 1 is the floor: the randomness of the last "
      "model itself; every step is measured with the same scale.");
  Plot plot;
  plot.name = "ladder";
  plot.alt = "held-out score after each step";
  plot.caption =
      "The error on captures held out, after each effect that was added. At the dashed line nothing is left but the "
      "last model's own randomness.";
  plot.y_label = "held-out score (1 = nothing left)";
  Curve curve;
  curve.label = "held-out score";
  Table table;
  table.columns = {"step",        "added", "held-out", "bias",  "noise",         "spectrum",
                   "mask",        "edges", "time",     "poses", "bias RMS (mm)", "noise, measured / simulated",
                   "proper score"};
  for (const auto& step : diagnosis.ladder) {
    curve.x.push_back(step.step);
    curve.y.push_back(step.score.heldout);
    const std::string name = step.name("the model given");
    plot.x_ticks.emplace_back(step.step, step.added.empty() ? name : "+ " + name);
    std::vector<TableCell> row{TableCell(step.step), TableCell(name), TableCell(step.score.heldout)};
    for (const char* channel : {"bias", "noise", "spectrum", "mask", "edges", "time", "poses"}) {
      const auto at = step.score.by_channel.find(channel);
      row.push_back(at == step.score.by_channel.end() ? TableCell("-") : TableCell(at->second));
    }
    row.push_back(TableCell(step.score.bias_rms_mm));
    row.push_back(TableCell(step.score.noise_ratio));
    row.push_back(TableCell(step.score.proper));
    table.rows.push_back(row);
  }
  if (curve.x.size() > 1) {
    plot.curves.push_back(curve);
    curve.stroke = Stroke::points;
    curve.label.clear();
    plot.curves.push_back(curve);
    plot.rules.push_back({1.0, "floor", false});
    plot.x_range = {{-0.3, diagnosis.ladder.back().step + 0.3}};
    plot.y_range = {{0, 1.1 * *std::max_element(curve.y.begin(), curve.y.end())}};
    page.figure(draw(plot));
  }
  const Score& last = diagnosis.ladder.back().score;
  table.caption = fmt::format(
      "The last model's own simulations score {} .. {} (95 %). The proper score (mean squared "
      "whitened residual plus logarithm of the determinant of the covariance, lower is better) punishes a model that "
      "only got noisier.",
      significant(last.band_low), significant(last.band_high));
  page.table(table);
}

Plot plot_of(const Course& course, const std::string& name, bool two_models) {
  Plot plot;
  plot.name = name;
  plot.title = course.segment + " over " + course.covariate;
  plot.alt = fmt::format("{} over {}", course.label, course.covariate_label);
  plot.caption = plot.title;
  plot.x_label = course.covariate_label;
  plot.y_label = course.label;
  plot.bands.push_back({"its own randomness", course.at, course.low, course.high, Ink::simulated});
  if (two_models) plot.curves.push_back({"model given", course.at, course.before, Ink::measured, Stroke::dashed});
  plot.curves.push_back({two_models ? "last model" : "model", course.at, course.after, Ink::measured, Stroke::line});
  plot.rules.push_back({course.even, "agree", false});
  return plot;
}

void where_section(Page& page, const Diagnosis& diagnosis) {
  if (diagnosis.maps.empty() && diagnosis.courses.empty()) return;
  const bool two_models = diagnosis.ladder.size() > 1;
  page.section(two_models ? "Where: before and after" : "Where");
  page.text(fmt::format(
      "Targets and lens stand where the measurement wants them. Curves are over what each statistic goes with most, "
      "mean over the captures held out; in the band lies what the {} does by chance (95 %). Maps are of the captures "
      "in which the model given leaves most.",
      two_models ? "last model" : "model"));
  int shown = 0;
  std::vector<Picture> pictures;
  for (const Course& course : diagnosis.courses)
    pictures.push_back(draw(plot_of(course, fmt::format("course_{}", ++shown), two_models)));
  if (!pictures.empty()) page.figures(pictures);
  shown = 0;
  for (const Maps& maps : diagnosis.maps) {
    MapFigure figure;
    figure.name = fmt::format("map_{}", ++shown);
    figure.alt = fmt::format("maps of {}", maps.label);
    figure.caption = fmt::format("{}: {}; {}{}", maps.capture, maps.segment, maps.label,
                                 maps.even == 0 ? "" : fmt::format(", less {}", maps.even));
    figure.unit = maps.segment == "bias" ? "mm" : "";
    figure.colours = ColourScale::diverging;
    if (two_models) figure.panels.push_back({"model given", maps.before - maps.even, maps.valid});
    figure.panels.push_back({two_models ? "last model" : "model", maps.after - maps.even, maps.valid});
    page.figure(figure);
  }
}

}  // namespace

Diagnosis run_diagnosis(const DiagnosisRun& run) {
  const RecordingSet set = RecordingSet::open(run.measured);
  SensorModel model = read_sensor_model(run.model, effect_catalogue());
  const Forward forward = open_forward_model(run.measured);
  const std::string projector = settle_projector(model, *forward.model);
  std::vector<CaptureReader> readers;
  for (const auto& capture : forward.model->captures()) readers.push_back(set.capture(capture.split, capture.id));
  SimulationCache cache = SimulationCache::standard();
  DiagnosisOptions options;
  options.most_effects = run.most_effects;
  options.seed = run.seed;
  options.provenance = std::filesystem::weakly_canonical(run.measured).filename().string() + ", split train";
  Diagnosis diagnosis = diagnose(
      *forward.model, [&](int c, int i) { return readers[c].frame(i); }, model, cache, options);
  if (!projector.empty()) diagnosis.warnings.push_back(projector);
  diagnosis.warnings.insert(diagnosis.warnings.end(), forward.notes.begin(), forward.notes.end());
  return diagnosis;
}

std::string diagnosis_words(const Diagnosis& diagnosis) {
  std::string text = diagnosis.headline + "\n";
  for (const auto& reason : diagnosis.reasons) text += "  " + reason + "\n";
  for (const auto& candidate : diagnosis.candidates)
    text += fmt::format("  {:<22} held-out score after: {:.3g}; {}\n", candidate.effect, candidate.heldout_after,
                        parameter_text(candidate));
  for (const auto& advice : diagnosis.advice) text += "  next: " + advice + "\n";
  return text;
}

std::string write_diagnosis_page(const Diagnosis& diagnosis, const DiagnosisRun& run, const std::string& folder,
                                 bool improve) {
  const std::string set_name = std::filesystem::weakly_canonical(run.measured).filename().string();
  Page page(improve ? "Improving " + std::filesystem::path(run.model).filename().string()
                    : "What " + std::filesystem::path(run.model).filename().string() + " lacks",
            "measured: " + set_name);
  page.fact("recording", set_name);
  page.fact("model", run.model);
  page.fact("verdict", verdict_name(diagnosis.verdict));
  page.fact("time", fmt::format("{:.0f} s, {} captures simulated", diagnosis.seconds, diagnosis.simulations));
  page.verdict(mark_of(diagnosis.verdict), diagnosis.headline, diagnosis.reasons);
  if (!diagnosis.advice.empty()) {
    page.section("What to do next");
    page.list(diagnosis.advice);
  }
  if (!diagnosis.ladder.empty()) ladder_section(page, diagnosis);
  if (!diagnosis.candidates.empty()) {
    page.section("What was found");
    Table table;
    table.columns = {"effect", "parameters (95 % interval)", "gain on captures held out",
                     "p",      "held-out score after",       "cannot be told from"};
    for (const auto& candidate : diagnosis.candidates)
      table.rows.push_back({candidate.effect, parameter_text(candidate), TableCell(candidate.evidence),
                            p_cell(candidate.p, candidate.null_count), TableCell(candidate.heldout_after),
                            fmt::format("{}", fmt::join(candidate.confounded_with, ", "))});
    page.table(table);
    page.subsection("Adding it by hand");
    page.text("Put these lines into the model's effects (they are in the improved model, too), and run again:");
    std::string lines;
    for (const auto& candidate : diagnosis.candidates) {
      std::vector<std::string> values;
      for (const auto& [parameter, value] : candidate.parameters)
        values.push_back(parameter.name + ": " + significant(value.value, 4));
      lines += fmt::format("  - {}: {{{}}}\n", candidate.effect, fmt::join(values, ", "));
    }
    page.code("effects:\n" + lines);
  }
  if (!diagnosis.present.empty()) {
    page.section("What the model already had");
    page.text(
        "Its own parameters, fitted together with everything else. A hypothesis is only held against what no value "
        "of these explains.");
    Table table;
    table.columns = {"effect", "parameter", "unit", "given", "fitted (95 % interval)", "remark"};
    for (const auto& entry : diagnosis.present)
      table.rows.push_back({entry.id, entry.name, entry.unit, TableCell(entry.given),
                            fmt::format("{} ({} .. {})", significant(entry.fitted, 4), significant(entry.low, 4),
                                        significant(entry.high, 4)),
                            entry.superfluous   ? "as good as absent: this recording needs no such effect"
                            : !entry.determined ? "not determined by this recording"
                            : entry.changed     ? "the value given does not fit this recording"
                                                : ""});
    page.table(table);
  }
  if (!diagnosis.unexplained.empty()) {
    page.section("What stays unexplained");
    Table table;
    table.columns = {"statistic", "times the model's own randomness", "goes with", "share explained by that", "shape"};
    for (const auto& entry : diagnosis.unexplained)
      table.rows.push_back({entry.segment, TableCell(entry.ratio), fmt::format("{}", fmt::join(entry.covariates, ", ")),
                            percent(entry.share), entry.shape});
    page.table(table);
    for (const auto& entry : diagnosis.unexplained)
      if (!entry.formula.empty()) {
        page.text("A formula fitted to it, to paste into the model's effects:");
        page.code(entry.formula);
      }
  }
  where_section(page, diagnosis);
  if (!diagnosis.ranking.empty()) {
    page.section("All hypotheses");
    page.text(
        "What each effect that the model lacks could explain on the train captures, in a linear view, before "
        "anything was added; the price is what chance explains on average.");
    auto ranking = diagnosis.ranking;
    std::sort(ranking.begin(), ranking.end(), [](const auto& a, const auto& b) { return a.gain > b.gain; });
    Table table;
    table.columns = {"effect", "explained (chi-square)", "price", "p"};
    for (const auto& entry : ranking)
      table.rows.push_back({entry.effect, TableCell(entry.gain), TableCell(entry.price),
                            p_cell(entry.p, diagnosis.candidates.empty() ? 0 : diagnosis.candidates[0].null_count)});
    page.begin_details("ranking of all effects");
    page.table(table);
    page.end_details();
  }
  if (!diagnosis.untested.empty()) {
    page.section("Not tested");
    page.text("This recording cannot show these effects; nothing is said about them.");
    std::vector<std::string> items;
    for (const auto& entry : diagnosis.untested)
      items.push_back(fmt::format("{}: needs {}", entry.effect, fmt::join(entry.needs, ", ")));
    page.list(items);
  }
  for (const auto& warning : diagnosis.warnings) page.note(warning);
  return page.write(folder);
}

}  // namespace binrig
