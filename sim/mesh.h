// Triangle meshes and what they are made of.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/pose.h"

namespace binrig {

/// Reflectance of a surface (EFFECTS.md: diffuse albedo 0..1, Phong specular 0..1 and exponent) and its colour.
struct Surface {
  float albedo = 0.5f, specular = 0.f, shininess = 30.f;
  std::array<float, 3> rgb{0.6f, 0.6f, 0.6f};  ///< 0..1
  bool assumed = false;                        ///< the file said nothing: 0.5 and 0 taken
};

/// Vertices in mm, in the frame O of the object. A triangle's normal follows its winding, but renderers turn normals
/// towards the viewer, so that open meshes render from both sides.
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint16_t> triangle_surface;  ///< per triangle: index into surfaces; empty = all 0
  std::vector<Surface> surfaces{Surface{}};     ///< at least one
  std::string name;                             ///< for messages
  std::uint64_t content_hash = 0;               ///< of vertices and triangles; keys caches

  void bounds(Eigen::Vector3f& low, Eigen::Vector3f& high) const;
  const Surface& surface_of(std::size_t triangle) const {
    return surfaces[triangle_surface.empty() ? 0 : triangle_surface[triangle]];
  }
};

/// Of vertices and triangles; never 0. Whoever makes a mesh puts it into content_hash when it is complete.
std::uint64_t hash_of(const Mesh& mesh);

/// What a mesh file's numbers mean.
enum class LengthUnit { mm, cm, m, inch };

/// Reads STL, COLLADA (whose files state their unit: `unit` does not count), OBJ or PLY. Vertices at equal places are
/// merged. Throws Error: cannot be read, no triangles, NaN
/// vertices (how many), more than 4 million triangles, or a diameter that looks like another unit (below 1 mm or above
/// 20 m: "is it in metres?").
std::shared_ptr<const Mesh> load_mesh(const std::string& path, LengthUnit unit = LengthUnit::mm);

/// A flat rectangle in the plane z = 0 of its frame, centred, width along x, height along y (mm).
std::shared_ptr<const Mesh> rectangle_mesh(double width_mm, double height_mm, const Surface& surface);
/// A box centred on the origin.
std::shared_ptr<const Mesh> box_mesh(const Eigen::Vector3d& size_mm, const Surface& surface);

}  // namespace binrig
