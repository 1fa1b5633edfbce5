// Maps of white noise through a Gaussian: what is bumpy without a plan, in the image and over depth.
#pragma once

#include <opencv2/core/mat.hpp>

#include "core/random.h"

namespace binrig {

/// CV_32F map of the size: white noise from `draws` through a Gaussian of sigma `length_px` (0 = white), of which the
/// expected standard deviation is `amplitude` (in whose unit the map is) at each pixel, those of the border included.
/// Autocovariance: amplitude^2 exp(-lag^2 / (4 length_px^2)). The draw costs more than all else in a frame: what was
/// drawn lately is kept, for any amplitude. From any thread. Precondition: neither side of the size nor length_px < 0.
cv::Mat smooth_noise(cv::Size size, double length_px, double amplitude, const RandomStream& draws);

}  // namespace binrig
