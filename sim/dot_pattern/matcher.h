// Block matching of two rectified images: for each pixel of the left image the disparity at which its surroundings
// look most alike in the right one.
#pragma once

#include <opencv2/core/mat.hpp>

#include "sim/dot_pattern/parameters.h"

namespace binrig::dot_pattern {

struct MatchSettings {
  Cost cost = Cost::zncc;
  int window_px = 11;                  ///< odd
  int lowest_px = 0, highest_px = 64;  ///< disparities that are tried, both included; at least three, any sign
  double min_correlation = 0.6, uniqueness = 0.05, max_left_right_px = 1;
  int speckle_size_px = 60;
  double speckle_step_px = 1;
  int full_scale = 1023;                                ///< counts
  double min_contrast = 0.004, saturated_share = 0.15;  ///< see parameters.cpp
  double disparity_step_px = 0;
};

struct Matches {
  cv::Mat disparity_px;  ///< CV_32F; meaningless where reason is not measured
  cv::Mat reason;        ///< CV_8U, values of Reason: measured, low_signal, saturated, border, out_of_range, no_match
};

/// left, right: CV_16U, counts up to 4095, as many rows each. The left pixel u corresponds to the right image's column
/// u - d - right_origin_px. Likeness is the zero-mean normalised cross-correlation of the two windows, or for census
/// (Zabih and Woodfill, "Non-parametric local transforms for computing visual correspondence", ECCV 1994; 7 x 7) one
/// minus twice the share of differing bits: 1 is alike, 0 unrelated. A parabola through the best likeness and its two
/// neighbours gives the fraction of a pixel. Sums are integers, so threads change no bit of the result.
/// Throws Error if the images do not fit each other or the settings.
Matches match_blocks(const cv::Mat& left, const cv::Mat& right, int right_origin_px, const MatchSettings& settings);

}  // namespace binrig::dot_pattern
