#include "compare/fidelity_report.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace binrig {

namespace {

Mark mark_of(Agreement agreement) {
  switch (agreement) {
    case Agreement::agrees:
      return Mark::good;
    case Agreement::differs:
      return Mark::bad;
    case Agreement::undecided:
      return Mark::open;
  }
  return Mark::none;
}

std::string shown_effect(const Aspect& a) {
  if (!std::isfinite(a.effect)) return "simulation only";
  if (a.effect_unit == "relative") return fmt::format("{:+.1f} %", 100 * a.effect);
  if (a.id == "spectrum") return fmt::format("{:.0f} % outside", 100 * a.effect);
  return fmt::format("{:+.3g}", a.effect);
}

std::string shown_tolerance(const Aspect& a) {
  return a.effect_unit == "relative" || a.id == "spectrum" ? fmt::format("{:.0f} %", 100 * a.tolerance)
                                                           : fmt::format("{:.3g}", a.tolerance);
}

std::string with_unit(const Aspect& a) { return a.unit == "1" ? a.title : a.title + ", " + a.unit; }

Table aspect_table(const std::vector<Aspect>& aspects, const std::string& caption) {
  Table table;
  table.caption = caption;
  table.columns = {"aspect", "measured", "simulated", "difference", "tolerance", "p", "outcome"};
  for (const Aspect& a : aspects) {
    table.rows.push_back({with_unit(a), a.id == "spectrum" ? TableCell("-") : TableCell(a.measured), a.simulated,
                          shown_effect(a), shown_tolerance(a), p_text(a.p_value),
                          TableCell(agreement_name(a.agreement), mark_of(a.agreement))});
  }
  return table;
}

cv::Mat crop(const cv::Mat& image, const cv::Rect& box) { return image.empty() ? image : image(box).clone(); }

std::vector<const CaptureFidelity*> chosen(const Fidelity& fidelity, int wanted) {
  std::vector<const CaptureFidelity*> pool;
  for (const auto& c : fidelity.captures) {
    if (c.held_out) pool.push_back(&c);
  }
  if (pool.empty()) {
    for (const auto& c : fidelity.captures) pool.push_back(&c);
  }
  // Captures with repeats show more.
  std::stable_sort(pool.begin(), pool.end(),
                   [](auto* a, auto* b) { return a->measured.distance_mm < b->measured.distance_mm; });
  std::vector<const CaptureFidelity*> out;
  const int n = static_cast<int>(pool.size());
  for (int i = 0; i < std::min(wanted, n); ++i)
    out.push_back(pool[wanted >= n || wanted < 2 ? i : i * (n - 1) / (wanted - 1)]);
  return out;
}

Plot over_distance(const Fidelity& fidelity, const std::string& name, const std::string& label, bool log_y,
                   Estimate NoiseProfile::*member) {
  Plot plot;
  plot.name = name;
  plot.x_label = "distance (mm)";
  plot.y_label = label;
  plot.log_y = log_y;
  Curve m{"measured", {}, {}, Ink::measured, Stroke::points}, s{"simulated", {}, {}, Ink::simulated, Stroke::rings};
  for (const auto& c : fidelity.captures) {
    m.x.push_back(c.measured.distance_mm);
    m.y.push_back((c.measured.*member).value);
    s.x.push_back(c.simulated.distance_mm);
    s.y.push_back((c.simulated.*member).value);
  }
  double most = 0, least = 1e300;
  for (const Curve* curve : {&m, &s}) {
    for (const double y : curve->y) {
      most = std::max(most, y);
      least = std::min(least, y);
    }
  }
  if (!log_y) plot.y_range = {{0, 1.15 * most + 1e-12}};
  if (log_y && least > 0) plot.y_range = {{0.7 * least, 1.6 * most}};
  plot.curves = {m, s};
  plot.alt = label + " of every capture over its distance, measured and simulated.";
  plot.caption = plot.alt;
  return plot;
}

MapFigure pair_of(const std::string& name, const std::string& unit, const CaptureFidelity& c,
                  cv::Mat NoiseProfile::*image, cv::Mat NoiseProfile::*valid, ColourScale colours) {
  MapFigure figure;
  figure.name = name;
  figure.unit = unit;
  figure.colours = colours;
  figure.origin = c.measured.box.tl();
  for (const NoiseProfile* p : {&c.measured, &c.simulated}) {
    const cv::Mat values = crop(p->*image, c.measured.box);
    const cv::Mat mask = valid ? crop(p->*valid, c.measured.box) : cv::Mat(values != 0);
    figure.panels.push_back({p == &c.measured ? "measured" : "simulated", values, mask});
  }
  return figure;
}

cv::Mat log_density(const NoiseSpectrum& density, double floor) {
  // The zero frequency in the middle; the half plane is mirrored.
  const int n = density.rows();
  cv::Mat out(n, n, CV_32F);
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      const double s = density.at((c - n / 2) / static_cast<double>(n), (r - n / 2) / static_cast<double>(n));
      out.at<float>(r, c) = static_cast<float>(std::log10(std::max(s, floor)));
    }
  }
  return out;
}

MapFigure density_maps(const std::string& name, const CaptureFidelity& c) {
  MapFigure figure;
  figure.name = name;
  figure.unit = "log10 of mm\u00b2 px\u00b2";
  const double floor = 1e-4 * c.measured.sigma_mm.value * c.measured.sigma_mm.value;
  figure.panels = {{"measured", log_density(c.measured.density, floor), {}},
                   {"simulated", log_density(c.simulated.density, floor), {}}};
  figure.alt = "two-dimensional power spectrum, zero frequency in the middle";
  figure.caption =
      "Two-dimensional power spectrum of the noise, from -0.5 to 0.5 cycles/px in both directions, zero in the middle. "
      "Ridges along the axes are noise common to rows or columns.";
  return figure;
}

Table metrics_table(const CaptureFidelity& c) {
  Table table;
  table.caption =
      "Figures of merit of the plane, as makers state them (formulas in compare/noise/plane_metrics.h), and the split "
      "after EMVA 1288.";
  table.columns = {"figure", "measured", "simulated", "unit"};
  const auto& m = c.measured;
  const auto& s = c.simulated;
  const auto add = [&](const std::string& what, std::optional<double> a, std::optional<double> b,
                       const std::string& unit) {
    if (a || b)
      table.rows.push_back({what, a ? TableCell(*a) : TableCell("-"), b ? TableCell(*b) : TableCell("-"), unit});
  };
  add("distance", m.metrics.distance_mm, s.metrics.distance_mm, "mm");
  add("fill rate", 100 * m.metrics.fill_rate, 100 * s.metrics.fill_rate, "%");
  add("Z-accuracy", m.metrics.z_accuracy_mm, s.metrics.z_accuracy_mm, "mm");
  add("plane-fit RMS", m.metrics.plane_rms_mm, s.metrics.plane_rms_mm, "mm");
  add("plane-fit RMS", m.metrics.percent_of_distance(m.metrics.plane_rms_mm),
      s.metrics.percent_of_distance(s.metrics.plane_rms_mm), "% of distance");
  add("sub-pixel RMS", m.metrics.subpixel_rms_px, s.metrics.subpixel_rms_px, "px");
  add("temporal noise (median of pixels)", m.metrics.temporal_noise_mm, s.metrics.temporal_noise_mm, "mm");
  if (m.split.done && s.split.done) {
    add("EMVA: temporal", m.split.temporal_mm, s.split.temporal_mm, "mm");
    add("EMVA: fixed pattern", m.split.spatial_mm, s.split.spatial_mm, "mm");
    add("EMVA: fixed, of rows", m.split.row_mm, s.split.row_mm, "mm");
    add("EMVA: fixed, of columns", m.split.column_mm, s.split.column_mm, "mm");
    add("EMVA: fixed, of pixels", m.split.pixel_mm, s.split.pixel_mm, "mm");
    add("temporal, of rows", m.split.temporal_row_mm, s.split.temporal_row_mm, "mm");
    add("temporal, of columns", m.split.temporal_column_mm, s.split.temporal_column_mm, "mm");
  }
  add("step of the values", m.quantisation.step_mm, s.quantisation.step_mm, "mm");
  add("whole plane's motion along the axis", m.frames > 1 ? std::optional(m.time.offset_sigma_mm) : std::nullopt,
      s.frames > 1 ? std::optional(s.time.offset_sigma_mm) : std::nullopt, "mm (sd)");
  return table;
}

void draw_capture(Page& page, const CaptureFidelity& c, const std::string& prefix, bool several) {
  std::string slug = c.capture;
  std::replace(slug.begin(), slug.end(), '/', '_');
  const std::string p = prefix + slug + "_";
  page.section(
      fmt::format("{} at {:.0f} mm, {}", c.measured.name, c.measured.distance_mm,
                  c.measured.frames == 1 ? std::string("one frame") : fmt::format("{} frames", c.measured.frames)));
  if (!c.measured.temporal) {
    page.note(
        "One frame only: noise and fixed pattern cannot be told apart, so the \u201cnoise\u201d here is the whole "
        "spatial residual, an "
        "upper bound for the noise. The simulated frame is read in the same way.");
  }
  const double step = std::max(c.measured.quantisation.step_mm, c.simulated.quantisation.step_mm);
  if (step > 0.5 * std::min(c.measured.sigma_mm.value, c.simulated.sigma_mm.value)) {
    page.note(fmt::format(
        "Values come in steps of {:.3g} mm, while the noise's standard deviation is {:.3g} mm (measured) and {:.3g} mm "
        "(simulated): tests of the distribution see the steps.",
        step, c.measured.sigma_mm.value, c.simulated.sigma_mm.value));
  }
  if (several)
    page.table(aspect_table(
        c.aspects,
        "What was asked of this capture. p-values are Holm-corrected over everything asked in this report."));

  auto depth =
      pair_of(p + "depth", "mm", c, &NoiseProfile::first_depth_mm, &NoiseProfile::first_valid, ColourScale::sequential);
  depth.alt = "depth of the first frame";
  depth.caption = "Depth of the first frame inside the flat region, both at the same colour scale.";
  page.figure(depth);
  auto residual = pair_of(p + "residual", "mm", c, &NoiseProfile::first_residual_mm, &NoiseProfile::first_valid,
                          ColourScale::diverging);
  residual.alt = "departure of the first frame from the plane";
  residual.caption = "Departure of the first frame from its plane, both at the same colour scale.";
  page.figure(residual);
  page.figure(residual_clouds(p + "cloud", c.measured, &c.simulated));
  std::vector<Picture> curves{draw(histogram_plot(p + "histogram", c.measured, &c.simulated)),
                              draw(spectrum_plot(p + "spectrum", c.measured, &c.simulated, &c.spectrum)),
                              draw(autocorrelation_plot(p + "autocorrelation", c.measured, &c.simulated))};
  if (c.measured.frames > 2) curves.push_back(draw(variogram_plot(p + "variogram", c.measured, &c.simulated)));
  page.figures(curves);
  page.figure(density_maps(p + "spectrum_2d", c));
  if (c.measured.temporal) {
    auto bias = pair_of(p + "bias", "mm", c, &NoiseProfile::bias_mm, &NoiseProfile::bias_known, ColourScale::diverging);
    bias.alt = "mean over the frames of the departure from the plane";
    bias.caption = fmt::format(
        "Bias map: the mean over {} frames of the departure from the plane. What a pixel keeps from frame to frame.",
        c.measured.frames);
    page.figure(bias);
    auto sigma = pair_of(p + "sigma", "mm", c, &NoiseProfile::temporal_sigma_mm, nullptr, ColourScale::sequential);
    sigma.alt = "standard deviation over time, pixel by pixel";
    sigma.caption = "Standard deviation over time, pixel by pixel.";
    page.figure(sigma);
  }
  if (c.measured.metrics.fill_rate < 0.998 || c.simulated.metrics.fill_rate < 0.998) {
    auto fill = pair_of(p + "fill", "share of frames", c, &NoiseProfile::fill, nullptr, ColourScale::grey);
    fill.low = 0;
    fill.high = 1;
    for (auto& panel : fill.panels) panel.valid = cv::Mat();
    fill.alt = "share of the frames in which a pixel was measured";
    fill.caption = "Share of the frames in which a pixel was measured; black outside the flat region, too.";
    page.figure(fill);
  }
  const auto& st = c.measured.stationarity;
  if (st.equal_everywhere.done && c.simulated.stationarity.equal_everywhere.done) {
    MapFigure cells{p + "evenness",
                    "noise level cell by cell",
                    "",
                    "share of the mean level",
                    {},
                    0.5,
                    1.5,
                    ColourScale::diverging,
                    {}};
    for (const NoiseProfile* one : {&c.measured, &c.simulated}) {
      const cv::Mat& map = one->stationarity.equal_everywhere.map;
      cells.panels.push_back({one == &c.measured ? "measured" : "simulated", map, cv::Mat(map > 0)});
    }
    cells.caption = fmt::format(
        "Noise level in cells of {} px against the whole region's. Measured: it varies by {:.0f} % beyond chance (p "
        "{}){}.",
        st.cell_px, 100 * st.scatter, p_text(st.equal_everywhere.p_value),
        st.explained > 0 ? fmt::format("; {:.0f} % of that goes with {}", 100 * st.explained, st.covariate) : "");
    page.figure(cells);
  }
  page.table(metrics_table(c));
  page.table(test_table(c.measured, &c.simulated));
  if (c.measured.white.rejected()) {
    page.text(fmt::format(
        "Independent Gaussian noise for every pixel, the usual simulation, cannot make these frames: that the measured "
        "pixels are independent is rejected with p {} (statistic {} against a threshold of {}).",
        p_text(c.measured.white.p_value), significant(c.measured.white.statistic),
        significant(c.measured.white.threshold)));
  }
}

}  // namespace

void draw_verdict(Page& page, const Fidelity& f) {
  page.verdict(mark_of(f.verdict), f.headline, f.reasons);
  page.table(aspect_table(
      f.overall,
      f.captures.size() > 1
          ? fmt::format("What agrees and what does not: the median over {} captures, the "
                        "smallest corrected p-value of them; an aspect differs if it differs in any capture.",
                        f.captures.size())
          : std::string("What agrees and what does not.")));
  page.note(
      "An aspect differs if it is beyond its tolerance and chance does not explain it (p < 0.05, Holm-corrected over "
      "everything asked "
      "here). Beyond the tolerance but explicable by chance is undecided.");
}

void draw_fidelity(Page& page, const Fidelity& f, int detailed, const std::string& prefix) {
  if (f.captures.size() > 1) {
    page.section("All captures");
    page.figures(
        {draw(over_distance(f, prefix + "sigma_over_distance", "noise level (mm)", false, &NoiseProfile::sigma_mm)),
         draw(over_distance(f, prefix + "correlation_over_distance", "correlation length (px)", false,
                            &NoiseProfile::correlation_length_px))});
    Table table;
    table.caption = "Every capture.";
    table.columns = {"capture",
                     "distance, mm",
                     "frames",
                     "sigma measured, mm",
                     "sigma simulated, mm",
                     "correlation length measured, px",
                     "simulated, px",
                     "frequencies in the band",
                     "differs in"};
    for (const auto& c : f.captures) {
      std::string differs;
      for (const auto& a : c.aspects) {
        if (a.agreement == Agreement::differs) differs += (differs.empty() ? "" : ", ") + a.id;
      }
      table.rows.push_back(
          {c.capture, significant(c.measured.distance_mm, 4), c.measured.frames, c.measured.sigma_mm.value,
           c.simulated.sigma_mm.value, c.measured.correlation_length_px.value, c.simulated.correlation_length_px.value,
           percent(c.spectrum.share_inside, 2),
           TableCell(differs.empty() ? "nothing" : differs, differs.empty() ? Mark::good : Mark::bad)});
    }
    page.table(table);
  }
  for (const CaptureFidelity* c : chosen(f, detailed)) draw_capture(page, *c, prefix, f.captures.size() > 1);
}

}  // namespace binrig
