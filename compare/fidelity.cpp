#include "compare/fidelity.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/error.h"

namespace binrig {

namespace {

constexpr double no_test = std::numeric_limits<double>::quiet_NaN();

/// A t test of the difference of two estimates.
double difference_p(double difference, double error_a, double error_b, double freedom_a, double freedom_b,
                    double& freedom) {
  const double error = std::hypot(error_a, error_b);
  freedom = std::max(1.0, std::min(freedom_a, freedom_b));
  return error > 0 ? student_two_sided(difference / error, freedom) : difference == 0 ? 1 : 0;
}

/// ln(simulated / measured) of two positive quantities.
Aspect ratio_aspect(const std::string& id, const std::string& title, const std::string& unit, const Estimate& measured,
                    const Estimate& simulated, double tolerance) {
  Aspect a{id, title, unit, measured.value, simulated.value};
  a.effect_unit = "relative";
  a.tolerance = tolerance;
  if (!(measured.value > 0)) {
    a.effect = simulated.value > 0 ? std::numeric_limits<double>::infinity() : 0;
    a.raw_p = simulated.value > 0 ? no_test : 1;
    return a;
  }
  a.effect = simulated.value / measured.value - 1;
  a.raw_p = difference_p(simulated.value - measured.value, measured.standard_error, simulated.standard_error,
                         measured.degrees_of_freedom, simulated.degrees_of_freedom, a.degrees_of_freedom);
  return a;
}

/// Largest distance of the two distribution functions, each sample at mean 0 and standard deviation 1.
double shape_distance(std::vector<float> a, std::vector<float> b) {
  const auto standardise = [](std::vector<float>& x) {
    double mean = 0, square = 0;
    for (const float v : x) mean += v / x.size();
    for (const float v : x) square += (v - mean) * (v - mean) / x.size();
    for (float& v : x) v = static_cast<float>((v - mean) / std::sqrt(std::max(square, 1e-300)));
    std::sort(x.begin(), x.end());
  };
  if (a.empty() || b.empty()) return 0;
  standardise(a);
  standardise(b);
  double worst = 0;
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    const float x = std::min(a[i], b[j]);
    while (i < a.size() && a[i] <= x) ++i;
    while (j < b.size() && b[j] <= x) ++j;
    worst = std::max(worst, std::abs(static_cast<double>(i) / a.size() - static_cast<double>(j) / b.size()));
  }
  return worst;
}

/// Share of measured pixels, compared cell by cell: neighbouring pixels are lost together.
Aspect fill_aspect(const NoiseProfile& m, const NoiseProfile& s) {
  Aspect a{"fill_rate", "measured share of the plane", "1", m.metrics.fill_rate, s.metrics.fill_rate};
  a.effect = a.simulated - a.measured;
  a.effect_unit = "1";
  a.tolerance = 0.02;
  constexpr int cell = 32;
  std::vector<double> differences, weights;
  for (int top = m.box.y; top < m.box.br().y; top += cell) {
    for (int left = m.box.x; left < m.box.br().x; left += cell) {
      double sum = 0, n = 0;
      for (int r = top; r < std::min(top + cell, m.box.br().y); ++r) {
        for (int c = left; c < std::min(left + cell, m.box.br().x); ++c) {
          const float fm = m.fill.at<float>(r, c), fs = s.fill.at<float>(r, c);
          // A pixel that neither ever measures and one outside the region look alike and say nothing.
          if (fm == 0 && fs == 0) continue;
          sum += fs - fm;
          n += 1;
        }
      }
      if (n > 0) {
        differences.push_back(sum);
        weights.push_back(n);
      }
    }
  }
  const double cells = static_cast<double>(differences.size());
  if (cells < 4) {
    a.raw_p = no_test;
    return a;
  }
  double total = 0, weight = 0, square = 0;
  for (std::size_t i = 0; i < differences.size(); ++i) {
    total += differences[i];
    weight += weights[i];
  }
  for (std::size_t i = 0; i < differences.size(); ++i)
    square += std::pow(differences[i] - total / weight * weights[i], 2);
  const double error = std::sqrt(square * cells / (cells - 1));
  a.degrees_of_freedom = cells - 1;
  a.raw_p = error > 0 ? student_two_sided(total / error, cells - 1) : total == 0 ? 1 : 0;
  return a;
}

Aspect line_aspect(const std::string& id, const std::string& title, const Estimate& m, const Estimate& s,
                   double sigma) {
  const auto root = [](double v) { return std::sqrt(std::max(0.0, v)); };
  Aspect a{id, title, "mm", root(m.value), root(s.value)};
  a.effect = sigma > 0 ? (a.simulated - a.measured) / sigma : 0;
  a.effect_unit = "of the noise level";
  a.tolerance = 0.1;
  a.raw_p = difference_p(s.value - m.value, m.standard_error, s.standard_error, m.degrees_of_freedom,
                         s.degrees_of_freedom, a.degrees_of_freedom);
  return a;
}

std::string effect_text(const Aspect& a) {
  if (!std::isfinite(a.effect)) return "present in the simulation alone";
  if (a.effect_unit == "relative")
    return fmt::format("{:.3g} % too {}", std::abs(100 * a.effect), a.effect > 0 ? "large" : "small");
  return fmt::format("off by {:.3g}{}", a.effect, a.effect_unit == "1" ? "" : " " + a.effect_unit);
}

Agreement judged(const Aspect& a) {
  if (std::abs(a.effect) <= a.tolerance) return Agreement::agrees;
  return std::isnan(a.p_value) || a.p_value < 0.05 ? Agreement::differs : Agreement::undecided;
}

}  // namespace

const char* agreement_name(Agreement agreement) {
  switch (agreement) {
    case Agreement::agrees:
      return "agrees";
    case Agreement::differs:
      return "differs";
    case Agreement::undecided:
      return "undecided";
  }
  return "";
}

CaptureFidelity compare_profiles(NoiseProfile measured, NoiseProfile simulated, const std::string& capture,
                                 bool held_out) {
  CaptureFidelity out;
  out.capture = capture;
  out.held_out = held_out;
  const NoiseProfile &m = measured, &s = simulated;
  out.spectrum = compare_spectra(m.spectrum, s.spectrum);
  out.distribution = same_distribution(m.independent_values, s.independent_values, false);
  out.shape = same_distribution(m.independent_values, s.independent_values, true);

  out.aspects.push_back(
      ratio_aspect("noise_level", "noise level (standard deviation)", "mm", m.sigma_mm, s.sigma_mm, 0.10));

  Aspect shape{"distribution", "shape of the distribution (excess kurtosis)", "1", m.marginal.excess_kurtosis,
               s.marginal.excess_kurtosis};
  shape.effect = shape_distance(m.independent_values, s.independent_values);
  shape.effect_unit = "largest distance of the distribution functions";
  shape.tolerance = 0.03;
  shape.raw_p = out.shape.done ? out.shape.p_value : no_test;
  shape.degrees_of_freedom = out.shape.degrees_of_freedom;
  if (out.shape.done) out.aspects.push_back(shape);

  if (out.spectrum.rings > 0) {
    Aspect spectrum{"spectrum", "spectrum (share of frequencies within the 95 % band)", "1", 1,
                    out.spectrum.share_inside};
    spectrum.effect = 1 - out.spectrum.share_inside;
    spectrum.effect_unit = "of the frequencies outside";
    spectrum.tolerance = 0.15;
    spectrum.raw_p = out.spectrum.worst_p;
    spectrum.degrees_of_freedom = out.spectrum.degrees_of_freedom;
    out.aspects.push_back(spectrum);
  }
  out.aspects.push_back(ratio_aspect("correlation_length", "correlation length (1/e)", "px", m.correlation_length_px,
                                     s.correlation_length_px, 0.15));
  out.aspects.push_back(line_aspect("row_noise", "noise common to a row", m.lines.row_variance_mm2,
                                    s.lines.row_variance_mm2, m.sigma_mm.value));
  out.aspects.push_back(line_aspect("column_noise", "noise common to a column", m.lines.column_variance_mm2,
                                    s.lines.column_variance_mm2, m.sigma_mm.value));
  if (m.time.frames_independent.done && s.time.frames_independent.done) {
    const Estimate &a = m.time.lag1_correlation, &b = s.time.lag1_correlation;
    Aspect memory{"frame_correlation", "correlation of successive frames", "1", a.value, b.value};
    memory.effect = b.value - a.value;
    memory.effect_unit = "1";
    memory.tolerance = 0.1;
    memory.raw_p = difference_p(memory.effect, a.standard_error, b.standard_error, a.degrees_of_freedom,
                                b.degrees_of_freedom, memory.degrees_of_freedom);
    out.aspects.push_back(memory);
  }
  if (m.split.done && s.split.done) {
    // The map's spread over space has the jackknife's standard error; the correction for temporal noise adds none to
    // speak of.
    const Estimate a{m.split.spatial_mm, m.bias_sigma_mm.standard_error, m.bias_sigma_mm.degrees_of_freedom};
    const Estimate b{s.split.spatial_mm, s.bias_sigma_mm.standard_error, s.bias_sigma_mm.degrees_of_freedom};
    Aspect pattern{"fixed_pattern", "fixed pattern (spread of the bias map)", "mm", a.value, b.value};
    // Against the noise, too: a pattern far below the noise is nobody's concern.
    pattern.effect = (b.value - a.value) / std::max({a.value, 0.5 * m.split.temporal_mm, 1e-9});
    pattern.effect_unit = "relative";
    pattern.tolerance = 0.25;
    pattern.raw_p = difference_p(b.value - a.value, a.standard_error, b.standard_error, a.degrees_of_freedom,
                                 b.degrees_of_freedom, pattern.degrees_of_freedom);
    out.aspects.push_back(pattern);
  }
  out.aspects.push_back(fill_aspect(m, s));
  if (m.quantisation.storage_step_mm > 0 && s.quantisation.storage_step_mm > 0) {
    Aspect step{"quantisation", "step of the values", "mm", m.quantisation.step_mm, s.quantisation.step_mm};
    step.effect = step.simulated / step.measured - 1;
    step.effect_unit = "relative";
    step.tolerance = 0.15;
    step.raw_p = no_test;
    out.aspects.push_back(step);
  }
  for (Aspect& a : out.aspects) a.capture = capture;
  out.measured = std::move(measured);
  out.simulated = std::move(simulated);
  return out;
}

Fidelity judge(std::vector<CaptureFidelity> captures, std::vector<Aspect> others) {
  Fidelity out;
  out.captures = std::move(captures);
  out.others = std::move(others);
  std::vector<Aspect*> asked_all;
  for (auto& c : out.captures) {
    for (auto& a : c.aspects) asked_all.push_back(&a);
  }
  for (auto& a : out.others) asked_all.push_back(&a);
  std::vector<double> raw;
  for (const Aspect* a : asked_all) {
    if (!std::isnan(a->raw_p)) raw.push_back(a->raw_p);
  }
  const auto corrected = holm(raw);
  std::size_t k = 0;
  std::vector<std::string> order;
  std::map<std::string, std::vector<const Aspect*>> by_id;
  for (Aspect* a : asked_all) {
    a->p_value = std::isnan(a->raw_p) ? no_test : corrected[k++];
    a->agreement = judged(*a);
    if (!by_id.contains(a->id)) order.push_back(a->id);
    by_id[a->id].push_back(a);
  }
  int differing = 0, open = 0;
  for (const auto& id : order) {
    auto all = by_id[id];
    std::sort(all.begin(), all.end(), [](const Aspect* a, const Aspect* b) { return a->effect < b->effect; });
    Aspect typical = *all[all.size() / 2];
    typical.capture.clear();
    typical.p_value = no_test;
    int differ = 0, undecided = 0;
    for (const Aspect* a : all) {
      if (std::isnan(typical.p_value) || a->p_value < typical.p_value) typical.p_value = a->p_value;
      differ += a->agreement == Agreement::differs;
      undecided += a->agreement == Agreement::undecided;
    }
    typical.agreement = differ ? Agreement::differs : undecided ? Agreement::undecided : Agreement::agrees;
    out.overall.push_back(typical);
    if (typical.agreement == Agreement::agrees) continue;
    ++(differ ? differing : open);
    const Aspect* worst = *std::max_element(all.begin(), all.end(), [](const Aspect* a, const Aspect* b) {
      return std::pair(static_cast<int>(a->agreement == Agreement::differs), std::abs(a->effect)) <
             std::pair(static_cast<int>(b->agreement == Agreement::differs), std::abs(b->effect));
    });
    std::string sentence =
        fmt::format("{}: measured {:.3g}, simulated {:.3g}{}, {}", worst->title, worst->measured, worst->simulated,
                    worst->unit == "1" ? "" : " " + worst->unit, effect_text(*worst));
    if (std::isnan(worst->measured)) {
      sentence =
          fmt::format("{}: {:.0f} %, {:.0f} % would do", worst->title, 100 * worst->simulated, 100 * worst->tolerance);
    }
    if (id == "spectrum")
      sentence =
          fmt::format("spectrum: only {:.0f} % of the frequencies lie within the 95 % band", 100 * worst->simulated);
    if (id == "distribution") {
      sentence = fmt::format("shape of the distribution: excess kurtosis measured {:.2f}, simulated {:.2f}",
                             worst->measured, worst->simulated);
    }
    if (all.size() > 1)
      sentence += fmt::format(" (worst of {} captures: {}; it {} in {})", all.size(), worst->capture,
                              differ ? "differs" : "is open", differ ? differ : undecided);
    out.reasons.push_back(sentence + (differ ? "." : "; chance could do that, more frames would tell."));
  }
  // Why a stationary model cannot do better, where the data say so.
  for (const auto& c : out.captures) {
    const Stationarity& st = c.measured.stationarity;
    if (!st.equal_everywhere.rejected() || st.scatter < 0.1) continue;
    std::string sentence = fmt::format(
        "{}: the measured noise is not equally strong everywhere (its standard deviation varies by {:.0f} % "
        "between places",
        c.capture, 100 * st.scatter);
    sentence += st.explained > 0.2 ? fmt::format("; {:.0f} % of that goes with {})", 100 * st.explained, st.covariate)
                                   : "; with nothing simple)";
    if (out.reasons.size() < 16)
      out.reasons.push_back(sentence + ": one spectrum for the whole image cannot show that.");
  }
  out.verdict = differing ? Agreement::differs : open ? Agreement::undecided : Agreement::agrees;
  const int asked = static_cast<int>(order.size());
  out.headline =
      differing ? fmt::format("The simulation differs from the measurement in {} of {} aspects.", differing, asked)
      : open    ? fmt::format("Nothing contradicts the simulation, but {} of {} aspects stay undecided.", open, asked)
                : fmt::format("The simulation agrees with the measurement in all {} aspects.", asked);
  return out;
}

std::vector<std::string> broken_limits(const Fidelity& fidelity, const std::map<std::string, double>& limits) {
  Violations violations;
  std::vector<std::string> broken, known{"spectrum_inside"};
  for (const auto& a : fidelity.overall) known.push_back(a.id);
  for (const auto& [key, limit] : limits) {
    const std::string id = key == "spectrum_inside" ? "spectrum" : key;
    bool asked = false;
    const auto check = [&, key = key, limit = limit](const Aspect& a) {
      if (a.id != id) return;
      asked = true;
      const double value = key == "spectrum_inside" ? a.simulated : std::abs(a.effect);
      const bool kept = key == "spectrum_inside" ? value >= limit : value <= limit;
      if (!kept) broken.push_back(fmt::format("{}: {} is {:.3g}, the limit {:.3g}", a.capture, key, value, limit));
    };
    for (const auto& c : fidelity.captures) {
      for (const auto& a : c.aspects) check(a);
    }
    for (const auto& a : fidelity.others) check(a);
    if (asked) continue;
    const std::string near = nearest_word(key, known);
    violations.add("", key,
                   near.empty() ? "was not compared here" : "was not compared here; did you mean " + near + "?");
  }
  violations.throw_if_any("limits that cannot be checked");
  return broken;
}

nlohmann::json fidelity_json(const Fidelity& f) {
  using nlohmann::json;
  const auto number = [](double x) { return std::isfinite(x) ? json(x) : json(nullptr); };
  const auto aspect = [&](const Aspect& a) {
    return json{{"aspect", a.id},
                {"title", a.title},
                {"unit", a.unit},
                {"measured", number(a.measured)},
                {"simulated", number(a.simulated)},
                {"effect", number(a.effect)},
                {"effect_unit", a.effect_unit},
                {"tolerance", a.tolerance},
                {"p_value", number(a.p_value)},
                {"p_value_uncorrected", number(a.raw_p)},
                {"degrees_of_freedom", a.degrees_of_freedom},
                {"agreement", agreement_name(a.agreement)}};
  };
  json out{{"verdict", agreement_name(f.verdict)}, {"headline", f.headline}, {"reasons", f.reasons}};
  out["aspects"] = json::array();
  for (const auto& a : f.overall) out["aspects"].push_back(aspect(a));
  out["scene_aspects"] = json::array();
  for (const auto& a : f.others) {
    out["scene_aspects"].push_back(aspect(a));
    out["scene_aspects"].back()["capture"] = a.capture;
  }
  out["captures"] = json::array();
  for (const auto& c : f.captures) {
    json one{{"capture", c.capture}, {"held_out", c.held_out}};
    for (const auto& a : c.aspects) one["aspects"].push_back(aspect(a));
    one["measured"] = profile_json(c.measured);
    one["simulated"] = profile_json(c.simulated);
    one["distribution_test"] = test_json(c.distribution);
    one["shape_test"] = test_json(c.shape);
    one["spectrum_comparison"] = {{"frequency_per_px", c.spectrum.frequency}, {"band_low", c.spectrum.band_low},
                                  {"band_high", c.spectrum.band_high},        {"p_value", c.spectrum.p_value},
                                  {"share_inside", c.spectrum.share_inside},  {"distance_db", c.spectrum.distance_db}};
    out["captures"].push_back(one);
  }
  return out;
}

}  // namespace binrig
