#include "sim/world_physics.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "sim/convex_hull.h"

namespace binrig {
namespace {

constexpr double steel_kg_m3 = 7850;
constexpr double worst_share_of_size = 0.02;

Vector3 size_of(const Mesh& mesh) {
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  return (high - low).cast<double>();
}

/// The convex hull as a mesh, for the mass of parts that collide as one.
Mesh hull_mesh(const Mesh& mesh) {
  std::vector<Vector3> points;
  for (const auto& v : mesh.vertices) points.push_back(v.cast<double>());
  const ConvexHull hull = convex_hull(points);
  Mesh out;
  out.name = mesh.name;
  for (const Vector3& v : hull.vertices) out.vertices.push_back(v.cast<float>());
  for (const auto& t : hull.triangles) {
    out.triangles.push_back(
        {static_cast<std::uint32_t>(t[0]), static_cast<std::uint32_t>(t[1]), static_cast<std::uint32_t>(t[2])});
  }
  return out;
}

void check_part(const WorldPart& part, Violations& violations) {
  const Mesh& mesh = *part.model.mesh;
  const std::string where = part.where + ": part " + part.model.name;
  Violations solid;
  if (part.hull) {
    if (hull_mesh(mesh).triangles.empty()) solid.add(where, "", "is flat: its convex hull has no volume");
  } else {
    check_solid(mesh, where, solid);
  }
  violations.add_all(solid.list());
  if (!solid.empty()) return;
  const double volume_mm3 = part.hull ? signed_volume_mm3(hull_mesh(mesh)) : signed_volume_mm3(mesh);
  if (part.mass_kg) {
    Violations wrong;
    check_density(*part.mass_kg / (volume_mm3 * 1e-9), volume_mm3, where, "mass", wrong);
    if (!wrong.empty()) {
      violations.add({where, "mass", number_text(*part.mass_kg), "kg",
                      fmt::format("{:.3g} .. {:.3g}", lowest_density_kg_m3 * volume_mm3 * 1e-9,
                                  highest_density_kg_m3 * volume_mm3 * 1e-9),
                      fmt::format("is no material's for {:.4g} cm^3", volume_mm3 * 1e-3)});
    }
  } else if (part.density_kg_m3) {
    check_density(*part.density_kg_m3, volume_mm3, where, "density", violations);
  }
}

}  // namespace

void check_physics(const World& world, Violations& violations) {
  std::set<int> falling;
  for (const WorldBin& bin : world.bins) {
    for (const auto& [index, count] : bin.fill) {
      const WorldPart& part = world.parts[static_cast<std::size_t>(index)];
      if (!part.model.mesh) continue;
      falling.insert(index);
      Vector3 size = size_of(*part.model.mesh);
      std::sort(size.data(), size.data() + 3);
      const double longer = std::max(bin.inner_size_mm.x(), bin.inner_size_mm.y()),
                   shorter = std::min(bin.inner_size_mm.x(), bin.inner_size_mm.y());
      if (size[2] > longer || size[1] > shorter) {
        violations.add({bin.where + ": bin " + bin.name, "inner_size", fmt::format("{:.4g} x {:.4g}", longer, shorter),
                        "mm", "",
                        fmt::format("is smaller than the part {}, {:.4g} x {:.4g} x {:.4g} mm", part.model.name,
                                    size[2], size[1], size[0])});
      }
    }
  }
  for (int index : falling) check_part(world.parts[static_cast<std::size_t>(index)], violations);
}

Body body_of(const WorldPart& part) {
  Violations violations;
  check_part(part, violations);
  violations.throw_if_any("The part " + part.model.name + " cannot fall.");
  const Mesh& mesh = *part.model.mesh;
  Body body;
  body.name = part.model.name;
  const ConvexPieces pieces = part.hull ? hull_piece(mesh) : cached_convex_pieces(mesh);
  const double allowed_mm = worst_share_of_size * size_of(mesh).norm();
  if (!part.hull && pieces.quality.hausdorff_mm > allowed_mm) {
    throw Error(
        "The part " + part.model.name + " is too intricate to fall.",
        {{part.where, "collision", number_text(pieces.quality.hausdorff_mm), "mm", "up to " + number_text(allowed_mm),
          fmt::format("is how far {} convex pieces miss its surface; a simpler mesh would do, or collision: hull",
                      pieces.pieces.size())}});
  }
  body.pieces = pieces.pieces;
  body.mass = mass_properties(part.hull ? hull_mesh(mesh) : mesh, part.density_kg_m3.value_or(steel_kg_m3));
  if (part.mass_kg) body.mass = with_mass(body.mass, *part.mass_kg);
  body.friction = part.friction;
  body.restitution = part.restitution;
  body.rolling_resistance_mm = part.rolling_resistance_mm;
  return body;
}

BinBox box_of(const WorldBin& bin) { return {bin.inner_size_mm, bin.wall_mm, bin.friction, bin.restitution}; }

}  // namespace binrig
