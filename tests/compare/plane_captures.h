// Captures of planes whose noise is known, for tests.
#pragma once

#include <cmath>
#include <functional>

#include <opencv2/core.hpp>

#include "compare/noise/plane_residual.h"
#include "core/random.h"
#include "core/spectrum.h"

namespace binrig::test {

struct MadePlane {
  int width = 240, height = 200, frames = 6;
  double distance_mm = 800, tilt_rad = 0.2;
  double sigma_mm = 0.3, correlation_px = 1, white_share = 0.2;
  double pattern_mm = 0;         ///< fixed, white
  double row_mm = 0;             ///< one draw a row and frame
  double column_pattern_mm = 0;  ///< fixed, one draw a column
  double holes = 0;              ///< share, new in every frame
  double memory = 0;             ///< first-order autoregression in time
  double drift_mm = 0;           ///< the plane moves away by this a frame
  double step_mm = 0;            ///< of depth
  double focal_baseline = 0, disparity_step_px = 0;
  double storage_mm = 0;
  std::function<double(int u, int v)> scale;  ///< factor on the noise
  std::uint64_t seed = 1;
};

inline PlaneCapture made_capture(const MadePlane& made) {
  PlaneCapture capture;
  capture.name = "made";
  capture.camera = camera_from_field_of_view(made.width, made.height, 0.9);
  capture.target.normal = Vector3(std::sin(made.tilt_rad), 0, -std::cos(made.tilt_rad));
  capture.target.offset_mm = -made.distance_mm * std::cos(made.tilt_rad);
  capture.target.region = cv::Mat(made.height, made.width, CV_8U, cv::Scalar(255));
  capture.focal_baseline_px_mm = made.focal_baseline;
  capture.frames = [made, capture](const FrameSink& sink) {
    const cv::Mat plane = plane_depth(capture.camera, capture.target);
    const NoiseSynthesis synthesis(NoiseSpectrum::parametric(made.height + 40, made.width + 40, made.sigma_mm,
                                                             made.correlation_px, made.white_share),
                                   true);
    const RandomStream fixed = RandomStream(made.seed).child("fixed");
    cv::Mat state;
    for (int t = 0; t < made.frames; ++t) {
      const RandomStream stream = RandomStream(made.seed).child(static_cast<std::uint64_t>(t));
      cv::Mat field;
      synthesis.synthesise(stream, field);
      state = t == 0 ? field : cv::Mat(made.memory * state + std::sqrt(1 - made.memory * made.memory) * field);
      Frame frame;
      frame.camera = capture.camera;
      frame.depth_scale_mm = made.storage_mm;
      frame.depth_mm.create(made.height, made.width, CV_32F);
      frame.reason = cv::Mat(made.height, made.width, CV_8U, cv::Scalar(0));
      for (int v = 0; v < made.height; ++v) {
        const double row = made.row_mm * stream.child("rows").normal(v);
        for (int u = 0; u < made.width; ++u) {
          const std::uint64_t i = static_cast<std::uint64_t>(v) * made.width + u;
          double z = plane.at<float>(v, u) + made.drift_mm * t + row +
                     state.at<float>(v, u) * (made.scale ? made.scale(u, v) : 1) + made.pattern_mm * fixed.normal(i) +
                     made.column_pattern_mm * fixed.child("columns").normal(u);
          if (made.step_mm > 0) z = std::round(z / made.step_mm) * made.step_mm;
          if (made.disparity_step_px > 0) {
            const double d = made.focal_baseline / z;
            z = made.focal_baseline / (std::round(d / made.disparity_step_px) * made.disparity_step_px);
          }
          if (made.storage_mm > 0) z = std::round(z / made.storage_mm) * made.storage_mm;
          frame.depth_mm.at<float>(v, u) = static_cast<float>(z);
          if (stream.child("holes").uniform(i) < made.holes) invalidate(frame, v, u, Reason::unknown);
        }
      }
      sink(frame, t);
    }
  };
  return capture;
}

}  // namespace binrig::test
