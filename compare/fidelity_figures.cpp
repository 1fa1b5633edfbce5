// The single figures of a fidelity report.
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "compare/fidelity_report.h"

namespace binrig {

namespace {

std::string noise_word(const NoiseProfile& p) { return p.temporal ? "temporal noise" : "residual of a single frame"; }

void add_density(Plot& plot, const NoiseProfile& p, const std::string& label, Ink ink) {
  plot.curves.push_back(histogram_curve(label, p.marginal.edges_mm, p.marginal.counts, ink));
}

std::vector<double> distances(std::size_t n) {
  std::vector<double> d(n);
  for (std::size_t i = 0; i < n; ++i) d[i] = static_cast<double>(i);
  return d;
}

}  // namespace

Plot histogram_plot(const std::string& name, const NoiseProfile& m, const NoiseProfile* s) {
  Plot plot;
  plot.name = name;
  plot.x_label = noise_word(m) + " (mm)";
  plot.y_label = "density (1/mm)";
  plot.log_y = true;
  add_density(plot, m, "measured", Ink::measured);
  if (s) add_density(plot, *s, "simulated", Ink::simulated);
  Curve normal{"Gaussian", {}, {}, Ink::reference, Stroke::dotted};
  const double sigma = std::max(m.marginal.sigma_mm, 1e-9);
  for (int i = -50; i <= 50; ++i) {
    const double z = i / 10.0;
    normal.x.push_back(z * sigma);
    normal.y.push_back(std::exp(-0.5 * z * z) / (sigma * std::sqrt(2 * CV_PI)));
  }
  plot.curves.push_back(normal);
  const double reach = 5 * std::max(sigma, s ? s->marginal.sigma_mm : 0);
  plot.x_range = {{-reach, reach}};
  plot.y_range = {{1e-5 / sigma, 1.5 / sigma}};
  plot.alt = fmt::format("Histogram of the {}: measured standard deviation {:.3g} mm{}.", noise_word(m),
                         m.marginal.sigma_mm, s ? fmt::format(", simulated {:.3g} mm", s->marginal.sigma_mm) : "");
  plot.caption = fmt::format(
      "Distribution of the {} on a logarithmic scale, with the Gaussian of the measured standard deviation ({:.3g} "
      "mm). Excess "
      "kurtosis: measured {:.2f}{}.",
      noise_word(m), m.marginal.sigma_mm, m.marginal.excess_kurtosis,
      s ? fmt::format(", simulated {:.2f}", s->marginal.excess_kurtosis) : "");
  return plot;
}

Plot spectrum_plot(const std::string& name, const NoiseProfile& m, const NoiseProfile* s,
                   const SpectrumComparison* comparison) {
  Plot plot;
  plot.name = name;
  plot.x_label = "spatial frequency (cycles/px)";
  plot.y_label = "power density (mm\u00b2 px\u00b2)";
  plot.log_y = true;
  const auto curve = [&](const NoiseProfile& p, const char* label, Ink ink) {
    Curve c{label, p.spectrum.frequency, {}, ink, ink == Ink::simulated ? Stroke::dashed : Stroke::line};
    for (const auto& e : p.spectrum.density) c.y.push_back(e.value);
    plot.curves.push_back(c);
  };
  if (comparison && comparison->rings > 0) {
    plot.bands.push_back(
        {"95 % band", comparison->frequency, comparison->band_low, comparison->band_high, Ink::simulated});
  }
  if (s) curve(*s, "simulated", Ink::simulated);
  curve(m, "measured", Ink::measured);
  Curve white{"white noise", {0, 0.5}, {}, Ink::reference, Stroke::dotted};
  white.y.assign(2, m.sigma_mm.value * m.sigma_mm.value);
  plot.curves.push_back(white);
  plot.x_range = {{0, 0.5}};
  plot.alt = "Radially averaged power spectrum of the " + noise_word(m) + ".";
  plot.caption = "Radially averaged power spectrum of the " + noise_word(m) + ".";
  if (comparison && comparison->rings > 0) {
    plot.caption += fmt::format(
        " The band is where the measured value is expected with 95 % probability, frequency by frequency, if the "
        "simulation is "
        "right; {:.0f} % of {} frequencies lie in it (root mean square distance {:.2f} dB).",
        100 * comparison->share_inside, comparison->rings, comparison->distance_db);
  }
  return plot;
}

Plot autocorrelation_plot(const std::string& name, const NoiseProfile& m, const NoiseProfile* s) {
  Plot plot;
  plot.name = name;
  plot.x_label = "distance (px)";
  plot.y_label = "autocorrelation";
  const auto add = [&](const NoiseProfile& p, const char* label, Ink ink) {
    plot.curves.push_back({label, distances(p.autocorrelation.size()), p.autocorrelation, ink,
                           ink == Ink::simulated ? Stroke::dashed : Stroke::line});
    plot.curves.push_back({"", distances(p.autocorrelation.size()), p.autocorrelation, ink,
                           ink == Ink::simulated ? Stroke::rings : Stroke::points});
  };
  add(m, "measured", Ink::measured);
  if (s) add(*s, "simulated", Ink::simulated);
  const double reach = std::max(m.correlation_length_px.value, s ? s->correlation_length_px.value : 0);
  plot.x_range = {{0, std::min(std::max(8.0, std::ceil(5 * reach)), std::max(8.0, m.autocorrelation.size() - 1.0))}};
  plot.rules = {{std::exp(-1.0), "1/e", false}, {0, "", false}};
  plot.alt =
      fmt::format("Autocorrelation over distance: falls to 1/e at {:.3g} px measured{}.", m.correlation_length_px.value,
                  s ? fmt::format(" and {:.3g} px simulated", s->correlation_length_px.value) : "");
  plot.caption =
      fmt::format("Autocorrelation of the {} averaged over directions. Correlation length (1/e): measured {:.3g} px{}.",
                  noise_word(m), m.correlation_length_px.value,
                  s ? fmt::format(", simulated {:.3g} px", s->correlation_length_px.value) : "");
  return plot;
}

CloudFigure residual_clouds(const std::string& name, const NoiseProfile& m, const NoiseProfile* s) {
  CloudFigure figure;
  figure.name = name;
  figure.unit = "mm from the plane";
  const double sigma = std::max(
      1e-6, static_cast<double>(m.marginal.robust_sigma_mm > 0 ? m.marginal.robust_sigma_mm : m.sigma_mm.value));
  double spread = 0;
  std::vector<float> residuals;
  for (int r = m.box.y; r < m.box.br().y; r += 3) {
    for (int c = m.box.x; c < m.box.br().x; c += 3) {
      if (m.first_valid.at<std::uint8_t>(r, c)) residuals.push_back(std::abs(m.first_residual_mm.at<float>(r, c)));
    }
  }
  if (!residuals.empty()) {
    const auto place = residuals.begin() + static_cast<std::ptrdiff_t>(0.98 * (residuals.size() - 1));
    std::nth_element(residuals.begin(), place, residuals.end());
    spread = *place;
  }
  const double limit = std::max(spread, 2 * sigma);
  figure.low = -limit;
  figure.high = limit;
  // Pixels stand for lengths in the plane; the residual is drawn so large that its 98 % point is 8 % of the width.
  const double gain = 0.08 * std::max(m.box.width, m.box.height) / limit;
  const auto panel = [&](const NoiseProfile& p, const char* title) {
    CloudPanel out{title, {}, {}};
    const int step = std::max(1, static_cast<int>(std::sqrt(p.box.area() / 30000.0)));
    for (int r = p.box.y; r < p.box.br().y; r += step) {
      for (int c = p.box.x; c < p.box.br().x; c += step) {
        if (!p.first_valid.at<std::uint8_t>(r, c)) continue;
        const double e = std::clamp<double>(p.first_residual_mm.at<float>(r, c), -4 * limit, 4 * limit);
        out.points.emplace_back(static_cast<float>(c), static_cast<float>(r), static_cast<float>(gain * e));
        out.values.push_back(static_cast<float>(e));
      }
    }
    return out;
  };
  figure.panels.push_back(panel(m, "measured"));
  if (s) figure.panels.push_back(panel(*s, "simulated"));
  figure.alt = "point cloud of the plane with its departures exaggerated";
  figure.caption = fmt::format(
      "The first frame as a point cloud (thesis Figures 5-19 and 5-20): columns and rows in pixels, the departure from "
      "the "
      "plane exaggerated to {:.3g} px a millimetre, for both alike.",
      gain);
  return figure;
}

Plot variogram_plot(const std::string& name, const NoiseProfile& m, const NoiseProfile* s) {
  Plot plot;
  plot.name = name;
  plot.x_label = "frames apart";
  plot.y_label = "half mean square difference (mm\u00b2)";
  const auto add = [&](const NoiseProfile& p, const char* label, Ink ink) {
    Curve c{label, {}, p.time.variogram_mm2, ink, ink == Ink::simulated ? Stroke::dashed : Stroke::line};
    for (std::size_t k = 0; k < c.y.size(); ++k) c.x.push_back(k + 1.0);
    plot.curves.push_back(c);
    c.label.clear();
    c.stroke = ink == Ink::simulated ? Stroke::rings : Stroke::points;
    plot.curves.push_back(c);
  };
  add(m, "measured", Ink::measured);
  if (s) add(*s, "simulated", Ink::simulated);
  double most = 0;
  for (const Curve& c : plot.curves) {
    for (const double y : c.y) most = std::max(most, y);
  }
  plot.y_range = {{0, 1.2 * most + 1e-12}};
  plot.x_range = {{0.5, m.time.variogram_mm2.size() + 0.5}};
  plot.alt = "Temporal variogram: half the mean square difference of frames against how many frames they are apart.";
  plot.caption =
      "How a pixel forgets: half the mean square difference of frames, over their distance in time. It is flat where "
      "successive "
      "frames are independent, and rises where noise lasts.";
  return plot;
}

Table test_table(const NoiseProfile& m, const NoiseProfile* s) {
  Table table;
  table.caption = "Hypotheses about the noise, one by one. n is the effective number of independent samples.";
  table.columns = {"hypothesis", "frames", "statistic", "threshold (5 %)", "degrees of freedom", "n", "p", "outcome"};
  const auto add = [&](const TestResult& t, const char* whose) {
    if (!t.done) {
      table.rows.push_back(
          {t.name, whose, "-", "-", "-", "-", "-", TableCell(t.method.empty() ? "not done" : t.method, Mark::none)});
      return;
    }
    table.rows.push_back({t.name, whose, t.statistic, t.threshold, fmt::format("{:.0f}", t.degrees_of_freedom),
                          fmt::format("{:.0f}", t.effective_n), p_text(t.p_value),
                          TableCell(t.rejected() ? "rejected" : "stands", Mark::none)});
  };
  const auto both = [&](auto&& pick) {
    add(pick(m), "measured");
    if (s) add(pick(*s), "simulated");
  };
  both([](const NoiseProfile& p) { return p.gaussian; });
  both([](const NoiseProfile& p) { return p.white; });
  both([](const NoiseProfile& p) { return p.lines.no_row_noise; });
  both([](const NoiseProfile& p) { return p.lines.no_column_noise; });
  if (m.frames > 1) both([](const NoiseProfile& p) { return p.time.frames_independent; });
  both([](const NoiseProfile& p) { return p.stationarity.equal_everywhere; });
  return table;
}

}  // namespace binrig
