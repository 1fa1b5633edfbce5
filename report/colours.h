// Colours of figures: few, fixed, told apart by people with any kind of colour vision, and legible in print.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace binrig {

using Rgb = std::array<std::uint8_t, 3>;
/// "#1f4e79"
std::string hex_colour(Rgb colour);

/// What a curve or a band stands for; the same everywhere in a report.
enum class Ink { measured, simulated, reference, third, fourth, fifth };
Rgb ink_colour(Ink ink);

/// Continuous colour scales of 255 different colours each, so that a colour can be read back as a value and one more is
/// left for pixels without one.
enum class ColourScale {
  sequential,  ///< dark blue over green to yellow: from little to much
  diverging,   ///< blue over near-white to red: departures from zero, on a symmetric scale
  grey,
};
const char* scale_name(ColourScale scale);
inline constexpr int scale_steps = 255;
const std::array<Rgb, scale_steps>& scale_colours(ColourScale scale);

/// What pixels without a value look like; in no scale.
inline constexpr Rgb absent_colour{222, 222, 226};

/// One kind of pixel in a map of kinds.
struct Category {
  std::string label;
  Rgb colour;
};
/// One category for each Reason (core/frame.h), indexed by its number; `measured` is nearly white.
const std::vector<Category>& reason_categories();

}  // namespace binrig
