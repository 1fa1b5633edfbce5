// The projected dots: pseudo-random places with no grid behind them, so that every window along an epipolar line looks
// different.
#pragma once

#include <opencv2/core/mat.hpp>

#include "sim/dot_pattern/parameters.h"

namespace binrig::dot_pattern {

/// Light as a function of the direction in which it leaves the projector, in pixels of the matched image: column
/// f p + cx, row f q + cy for the direction (p, q, 1).
class Pattern {
 public:
  /// Covers columns first_column .. first_column + columns - 1 and rows 0 .. rows - 1 with some margin; beyond, it
  /// repeats. Dots lie at least 0.6 spacings apart (dart throwing: Cook, "Stochastic sampling in computer graphics",
  /// ACM TOG 5(1), 1986) and differ in brightness by up to a third.
  Pattern(const Parameters& parameters, int first_column, int columns, int rows);

  /// The peak of the brightest single dot is 1; between the dots `background`. Bilinear in a raster of four samples a
  /// pixel, which adds less than 0.02 px^2 to a dot's variance.
  float at(float column, float row) const;

  /// What a perfect camera at the projector's place would record: CV_16U, mean over each pixel of the pattern blurred
  /// by `blur_px`, scaled so that a dot's peak of 1 is `peak` counts.
  cv::Mat image(int first_column, int columns, int rows, double blur_px, int peak) const;

 private:
  float left_ = 0, top_ = 0;  // of the raster's first sample
  cv::Mat raster_;            // CV_32F
};

}  // namespace binrig::dot_pattern
