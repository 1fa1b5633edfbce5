// What both renderers share: from "which triangle does each pixel see" to the channels, exactly, on the CPU.
//
// A renderer answers two questions of visibility only: which triangle is first along each viewing ray, and how far a
// visible point lies behind the first surface that a light sees. Depth is then the intersection of the exact viewing
// ray with the plane of that triangle in double precision, so that neither the rasteriser's grid nor single-precision
// ray parameters show in it, and lens distortion costs nothing.
#pragma once

#include <memory>
#include <string>

#include <opencv2/core/mat.hpp>

#include "sim/renderer.h"

namespace binrig {

/// Per pixel: the object (CV_16U, 0 = none, k = objects[k-1]) and its triangle (CV_32S) first along the ray.
struct FirstHits {
  cv::Mat object, triangle;
};

/// A triangle in the camera frame.
struct PlacedTriangle {
  Vector3 normal = Vector3::Zero();  ///< unit, after its winding
  double offset_mm = 0;              ///< normal . p of its plane
  double z_min_mm = 0, z_max_mm = 0;  ///< its extent and a little more: what its plane may be asked for
};
PlacedTriangle placed_triangle(const SceneObject& object, std::uint32_t triangle);

/// The renderer's part. `rays` is the table of core/ray_table.h.
class Visibility {
 public:
  virtual ~Visibility() = default;
  virtual FirstHits first_hits(const cv::Mat& rays) = 0;
  /// CV_32F, mm: for every pixel with depth, how far its point lies behind the first triangle on the ray from
  /// `light_mm` (camera frame); 0 where nothing is nearer than within `lit_within_mm`. `hits` are those of
  /// first_hits().
  virtual cv::Mat gaps(const Vector3& light_mm, const cv::Mat& rays, const cv::Mat& depth_mm,
                       const FirstHits& hits) = 0;
};

/// A point this near behind the first surface is on it: single-precision rays know no better.
inline constexpr float lit_within_mm = 0.02f;

/// Throws Error if the camera is inside a closed mesh and the request wants that checked, or if the camera is not one.
std::shared_ptr<const Channels> render_channels(const RenderScene& scene, const RenderRequest& request,
                                                Visibility& visibility);

std::unique_ptr<Renderer> make_embree_renderer();
std::unique_ptr<Renderer> make_osmesa_renderer();
std::unique_ptr<Renderer> make_plane_renderer();

}  // namespace binrig
