// Render channels: what is perfectly known of a scene from one view, before any sensor speaks.
#pragma once

#include <cstdint>
#include <memory>

#include <opencv2/core/mat.hpp>

#include "core/camera.h"

namespace binrig {

/// Names of the images in Channels, as bits, so that only what somebody reads is made.
enum class Channel : std::uint32_t {
  depth = 1u << 0,          ///< always made
  normal = 1u << 1,
  cos_incidence = 1u << 2,
  instance = 1u << 3,
  projector_gap = 1u << 4,
  diffuse = 1u << 5,
  specular = 1u << 6,
  ir = 1u << 7,
  edge_distance = 1u << 8,
  crease_distance = 1u << 9,
  rgb = 1u << 10,
};
using ChannelSet = std::uint32_t;
constexpr ChannelSet operator|(Channel a, Channel b) { return static_cast<ChannelSet>(a) | static_cast<ChannelSet>(b); }
constexpr ChannelSet operator|(ChannelSet a, Channel b) { return a | static_cast<ChannelSet>(b); }
constexpr bool contains(ChannelSet set, Channel channel) { return (set & static_cast<ChannelSet>(channel)) != 0; }

/// All images are height x width of `camera`. Where the ray meets nothing, depth is 0 and every other channel 0
/// (cos_incidence too). Images that were not asked for are empty. Immutable once made: shared between runs.
struct Channels {
  Camera camera;
  cv::Mat depth_mm;          ///< CV_32F, Z
  cv::Mat normal;            ///< CV_32FC3, unit, camera frame, turned towards the camera
  cv::Mat cos_incidence;     ///< CV_32F, cosine of the angle between viewing ray and normal, 0..1
  cv::Mat instance;          ///< CV_16U, 0 = none, k = k-th object of the scene
  cv::Mat projector_gap_mm;  ///< CV_32F, how far (mm, along the projector's ray) the point lies behind the first surface
                             ///< that the projector sees there; 0 = lit. Absent projector: empty
  cv::Mat diffuse;           ///< CV_32F, albedo * cos(theta_L) * (z0 / r_L)^2, shadow not applied
  cv::Mat specular;          ///< CV_32F, ks * max(0, R.V)^n, shadow not applied
  cv::Mat ir;                ///< CV_32F, V (diffuse + 0.5 specular), V = 1 where projector_gap_mm <= shadow epsilon
  cv::Mat edge_px;           ///< CV_32F, distance to the nearest depth edge, px; clipped at 64
  cv::Mat crease_px;         ///< CV_32F, distance to the nearest concave crease, px; clipped at 64
  cv::Mat rgb;               ///< CV_8UC3, R G B

  ChannelSet present() const;
};

/// A point counts as lit where it lies at most this far behind the first surface the projector sees.
inline constexpr float shadow_epsilon_mm = 0.05f;

/// Depth edges and concave creases from depth and normals (EFFECTS.md): an edge is a pair of neighbours whose depths
/// differ by more than 8 mm beyond what their surface normals predict; a crease is a pair whose normals' dot product
/// is below 0.9, folded towards the camera, with a depth step below 6 mm. Distances are Euclidean, from pixel centre to
/// the nearest pixel at an edge (the pixels of the pair are at 0.5). Fills edge_px and crease_px as `wanted` says;
/// needs depth_mm and normal.
void add_edge_channels(Channels& channels, ChannelSet wanted);

}  // namespace binrig
