// PNG files of pictures.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "report/colours.h"

namespace binrig {

/// An image of at most 256 colours: a byte a pixel, unfiltered, a third of what the same picture takes in RGB (noise in
/// colour hardly compresses otherwise). `index`: CV_8U. Throws Error if it is empty, the palette has 0 or more than 256
/// colours, or an index lies beyond it.
std::vector<std::uint8_t> indexed_png(const cv::Mat& index, const std::vector<Rgb>& palette);

/// An RGB image (CV_8UC3).
std::vector<std::uint8_t> rgb_png(const cv::Mat& rgb);

}  // namespace binrig
