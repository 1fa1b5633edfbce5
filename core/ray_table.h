// Viewing rays of whole images, computed once per camera.
#pragma once

#include <opencv2/core/mat.hpp>

#include "core/camera.h"

namespace binrig {

/// CV_32FC2, height x width: (x/z, y/z) of the ray through each pixel centre. Cached for the cameras used last and
/// shared: do not write to it. Thread-safe.
cv::Mat ray_table(const Camera& camera);

/// The same in double precision, CV_64FC2: for fits. Cached and shared as well.
cv::Mat exact_ray_table(const Camera& camera);

}  // namespace binrig
