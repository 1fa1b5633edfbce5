// Curves, bands and histograms, drawn by gnuplot in a process of its own.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "report/colours.h"

namespace binrig {

/// A finished picture with the words that go with it.
struct Picture {
  std::string name;  ///< file name beside the page, without ".png"
  std::string alt;   ///< what a reader who cannot see it has to know
  std::string caption;
  std::vector<std::uint8_t> png;
  int width_px = 0;  ///< width on the page; the PNG has twice as many pixels
};

enum class Stroke { line, dashed, dotted, points, rings, steps, boxes };

struct Curve {
  std::string label;  ///< "" = not in the key
  std::vector<double> x, y;
  Ink ink = Ink::measured;
  Stroke stroke = Stroke::line;
};

/// The area between two curves.
struct Band {
  std::string label;
  std::vector<double> x, low, high;
  Ink ink = Ink::measured;
};

/// A straight line over the whole plot with a word beside it.
struct Rule {
  double at = 0;
  std::string label;
  bool vertical = true;
};

struct Plot {
  std::string name, alt, caption;
  std::string title, x_label, y_label;  ///< labels carry the unit: "frequency (cycles/px)"
  bool log_x = false, log_y = false;
  std::optional<std::array<double, 2>> x_range, y_range;
  std::vector<std::pair<double, std::string>> x_ticks;  ///< where and what; empty = numbers where they fit
  std::vector<Band> bands;                              ///< drawn first
  std::vector<Curve> curves;
  std::vector<Rule> rules;
  int width_px = 520, height_px = 340;
};

/// Draws with gnuplot. On a logarithmic axis points that are not positive are left out, as are points that are not
/// finite. Throws Error: gnuplot missing (and how to install it), its complaint if it fails, curves whose x and y
/// differ in length, nothing to draw.
Picture draw(const Plot& plot);

/// A histogram's counts as a curve in steps: density per unit of x, so that histograms of different sizes compare.
/// `edges` has one element more than `counts`. Throws Error otherwise.
Curve histogram_curve(const std::string& label, const std::vector<double>& edges, const std::vector<double>& counts,
                      Ink ink);

}  // namespace binrig
