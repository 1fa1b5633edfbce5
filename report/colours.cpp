#include "report/colours.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/frame.h"

namespace binrig {

namespace {

// Piecewise linear through evenly spaced colours, so that all differ.
template <std::size_t N>
std::array<Rgb, scale_steps> ramp(const std::array<std::array<double, 3>, N>& knots) {
  std::array<Rgb, scale_steps> table{};
  for (int i = 0; i < scale_steps; ++i) {
    const double place = i / (scale_steps - 1.0) * (N - 1);
    const std::size_t k = std::min(N - 2, static_cast<std::size_t>(place));
    for (int c = 0; c < 3; ++c) {
      table[i][c] = static_cast<std::uint8_t>(std::lround(knots[k][c] + (place - k) * (knots[k + 1][c] - knots[k][c])));
    }
    if (i > 0 && table[i] == table[i - 1]) ++table[i][2];  // rounding made two alike: a colour must name one value
  }
  return table;
}

// After viridis (van der Walt and Smith): lightness grows evenly, and it survives grey print.
std::array<Rgb, scale_steps> sequential() {
  return ramp<10>({{{68, 1, 84},
                    {72, 40, 120},
                    {62, 74, 137},
                    {49, 104, 142},
                    {38, 130, 142},
                    {31, 158, 137},
                    {53, 183, 121},
                    {109, 205, 89},
                    {180, 222, 44},
                    {253, 231, 37}}});
}

// The middle is not quite white, so that zero is told from paper.
std::array<Rgb, scale_steps> diverging() {
  return ramp<7>({{{24, 51, 110},
                   {52, 108, 172},
                   {146, 190, 222},
                   {246, 246, 244},
                   {243, 178, 140},
                   {208, 85, 66},
                   {118, 16, 38}}});
}

std::array<Rgb, scale_steps> greys() {
  std::array<Rgb, scale_steps> table{};
  for (int i = 0; i < scale_steps; ++i) table[i].fill(static_cast<std::uint8_t>(i));
  return table;
}

}  // namespace

std::string hex_colour(Rgb colour) { return fmt::format("#{:02x}{:02x}{:02x}", colour[0], colour[1], colour[2]); }

Rgb ink_colour(Ink ink) {
  switch (ink) {
    case Ink::measured:
      return {22, 78, 138};
    case Ink::simulated:
      return {209, 98, 20};
    case Ink::reference:
      return {90, 94, 102};
    case Ink::third:
      return {0, 132, 104};
    case Ink::fourth:
      return {168, 70, 130};
    case Ink::fifth:
      return {150, 124, 10};
  }
  return {0, 0, 0};
}

const char* scale_name(ColourScale scale) {
  switch (scale) {
    case ColourScale::sequential:
      return "sequential";
    case ColourScale::diverging:
      return "diverging";
    case ColourScale::grey:
      return "grey";
  }
  return "";
}

const std::array<Rgb, scale_steps>& scale_colours(ColourScale scale) {
  static const std::array<Rgb, scale_steps> tables[] = {sequential(), diverging(), greys()};
  return tables[static_cast<int>(scale)];
}

const std::vector<Category>& reason_categories() {
  static const std::vector<Category> categories = [] {
    const std::array<Rgb, reason_count> colours{{{246, 246, 244},
                                                 {176, 178, 186},
                                                 {40, 62, 120},
                                                 {94, 150, 214},
                                                 {240, 190, 40},
                                                 {204, 82, 40},
                                                 {98, 58, 40},
                                                 {120, 134, 96},
                                                 {150, 80, 160},
                                                 {0, 0, 0},
                                                 {28, 140, 120},
                                                 {232, 130, 170},
                                                 {128, 20, 50}}};
    std::vector<Category> list;
    for (int i = 0; i < reason_count; ++i) {
      std::string label = reason_name(static_cast<Reason>(i));
      for (char& c : label) c = c == '_' ? ' ' : c;
      list.push_back({label, colours[i]});
    }
    return list;
  }();
  return categories;
}

}  // namespace binrig
