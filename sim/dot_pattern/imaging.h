// What a camera's sensor receives and records while the pattern lies on a scene.
#pragma once

#include <opencv2/core/mat.hpp>

#include "core/random.h"
#include "sim/dot_pattern/pattern.h"
#include "sim/renderer.h"

namespace binrig::dot_pattern {

/// Everything in the frame of the camera that looks.
struct Exposure {
  Camera camera;  ///< ideal, at the resolution of the matched image; no lens distortion
  Vector3 projector_mm = Vector3::Zero();
  double projector_yaw_rad = 0;  ///< about y; positive turns the pattern towards -x
  Camera pattern_camera;         ///< whose f, cx, cy give the pattern's pixels
  double reference_distance_mm = 800;
  bool residual_lens = true;  ///< whether the lens has k1 .. prism_y
};

/// Irradiance at each pixel, CV_32F, with the peak of a dot on a white surface at the reference distance as 1: the
/// pattern where the projector sees the surface, times diffuse + 0.5 specular (core/channels.h), and ambient light
/// times albedo; seen through the lens, blurred by its optics and averaged over the pixel.
///
/// Residual distortion after Brown 1966 with the thin prism of Weng, Cohen and Herniou, "Camera calibration with
/// distortion models and accuracy evaluation", IEEE PAMI 14(10), 1992, in OpenCV's signs; the light is resampled
/// (bicubic, on the supersampled grid).
cv::Mat irradiance(const RenderScene& scene, const Exposure& exposure, const Pattern& pattern,
                   const Parameters& parameters, const Renderer& renderer);

/// One image in counts, CV_16U: photon noise (Gaussian of the photons' variance), read noise, full well, converter.
/// `irradiance` is in the units above.
cv::Mat record(const cv::Mat& irradiance, const Parameters& parameters, const RandomStream& draws);

/// Where the unit's pixels are dead: CV_8U, 0 = fine, 1 = always dark, 2 = always full.
cv::Mat dead_pixel_map(cv::Size size, double share, const RandomStream& unit_draws);

/// Share of the light that a speck on the lens lets through, CV_32F, 1 = all; empty where there is none.
cv::Mat dust_map(const Camera& camera, const Parameters& parameters);

}  // namespace binrig::dot_pattern
