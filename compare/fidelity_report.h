// Draws a fidelity comparison into a report.
#pragma once

#include <string>

#include "compare/fidelity.h"
#include "report/page.h"

namespace binrig {

/// The verdict in words and the table of what agrees: the page's beginning.
void draw_verdict(Page& page, const Fidelity& fidelity);

/// Everything below it: sigma and correlation length over distance where there are several captures, then at most
/// `detailed` captures (held-out ones first, spread over distance) with maps, clouds, histograms, spectra, correlation
/// and tests. `prefix` keeps figure names apart.
void draw_fidelity(Page& page, const Fidelity& fidelity, int detailed = 3, const std::string& prefix = "");

/// Parts for other reports. One profile beside another (or none: nullptr).
Plot histogram_plot(const std::string& name, const NoiseProfile& measured, const NoiseProfile* simulated);
Plot spectrum_plot(const std::string& name, const NoiseProfile& measured, const NoiseProfile* simulated,
                   const SpectrumComparison* comparison);
Plot autocorrelation_plot(const std::string& name, const NoiseProfile& measured, const NoiseProfile* simulated);
/// Needs at least three frames.
Plot variogram_plot(const std::string& name, const NoiseProfile& measured, const NoiseProfile* simulated);
CloudFigure residual_clouds(const std::string& name, const NoiseProfile& measured, const NoiseProfile* simulated);
Table test_table(const NoiseProfile& measured, const NoiseProfile* simulated);

}  // namespace binrig
