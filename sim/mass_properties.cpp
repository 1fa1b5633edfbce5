#include "sim/mass_properties.h"

#include <cmath>
#include <map>

#include <fmt/format.h>
#include <Eigen/Geometry>

namespace binrig {
namespace {

// Volumes below this share of the bounding box count as none: a folded sheet.
constexpr double least_volume_share = 1e-6;

std::string place(const Eigen::Vector3f& p) { return fmt::format("({:.4g}, {:.4g}, {:.4g})", p.x(), p.y(), p.z()); }

struct EdgeUse {
  int forward = 0, backward = 0;  ///< from the lower vertex index to the higher, and the other way
};

}  // namespace

void check_solid(const Mesh& mesh, const std::string& where, Violations& violations) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, EdgeUse> edges;
  for (const auto& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if (a == b) continue;
      EdgeUse& use = edges[{std::min(a, b), std::max(a, b)}];
      ++(a < b ? use.forward : use.backward);
    }
  }
  int open = 0, crowded = 0, contrary = 0;
  std::string open_places, crowded_places, contrary_places;
  const auto note = [&](int& count, std::string& places, const auto& edge) {
    if (++count <= 3) {
      places += (count > 1 ? ", " : "") + place(mesh.vertices[edge.first]) + " to " + place(mesh.vertices[edge.second]);
    } else if (count == 4) {
      places += ", ...";
    }
  };
  for (const auto& [edge, use] : edges) {
    const int total = use.forward + use.backward;
    if (total == 1) {
      note(open, open_places, edge);
    } else if (total > 2 && use.forward != use.backward) {
      note(crowded, crowded_places, edge);
    } else if (use.forward != use.backward) {
      note(contrary, contrary_places, edge);
    }
  }
  const std::string hull = "; `collision: hull` takes the convex hull instead";
  if (open > 0) {
    violations.add(
        {where, "", std::to_string(open), "", "", "open edges: the surface has holes, at (mm) " + open_places + hull});
  }
  if (crowded > 0) {
    violations.add({where, "", std::to_string(crowded), "", "",
                    "edges belong to more than two triangles, at (mm) " + crowded_places + hull});
  }
  if (contrary > 0) {
    violations.add({where, "", std::to_string(contrary), "", "",
                    "edges between triangles that face opposite ways, at (mm) " + contrary_places + hull});
  }
  if (open + crowded + contrary > 0) return;
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  const Eigen::Vector3d size = (high - low).cast<double>();
  const double box = std::pow(std::max(size.norm(), 1e-9), 3.0);
  const double volume = signed_volume_mm3(mesh);
  if (std::abs(volume) < least_volume_share * box) {
    violations.add({where, "", number_text(volume), "mm^3", "", "is no volume: the surface encloses nothing"});
  } else if (volume < 0) {
    violations.add({where, "", number_text(volume), "mm^3", "",
                    "volume is negative: all triangles are wound inwards (turn the surface inside out)"});
  }
}

void check_density(double density_kg_m3, double volume_mm3, const std::string& where, const std::string& key,
                   Violations& violations) {
  if (density_kg_m3 >= lowest_density_kg_m3 && density_kg_m3 <= highest_density_kg_m3) return;
  const double mass_kg = density_kg_m3 * volume_mm3 * 1e-9;
  violations.add({where, key, number_text(density_kg_m3), "kg/m^3",
                  number_text(lowest_density_kg_m3) + " .. " + number_text(highest_density_kg_m3),
                  fmt::format("is no material: {:.4g} cm^3 would weigh {:.4g} kg (steel is 7850, ABS 1050; "
                              "1 g/cm^3 = 1000 kg/m^3)",
                              volume_mm3 * 1e-3, mass_kg)});
}

double signed_volume_mm3(const Mesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  const Vector3 base = mesh.vertices.front().cast<double>();
  double volume = 0;
  for (const auto& t : mesh.triangles) {
    const Vector3 a = mesh.vertices[t[0]].cast<double>() - base, b = mesh.vertices[t[1]].cast<double>() - base,
                  c = mesh.vertices[t[2]].cast<double>() - base;
    volume += a.dot(b.cross(c)) / 6;
  }
  return volume;
}

MassProperties mass_properties(const Mesh& mesh, double density_kg_m3) {
  MassProperties result;
  if (mesh.vertices.empty()) return result;
  // About a point near the body, so that large coordinates do not cancel.
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  const Vector3 base = (0.5f * (low + high)).cast<double>();
  Vector3 first = Vector3::Zero();                   // integral of p
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();  // integral of p p^T
  for (const auto& t : mesh.triangles) {
    const Vector3 a = mesh.vertices[t[0]].cast<double>() - base, b = mesh.vertices[t[1]].cast<double>() - base,
                  c = mesh.vertices[t[2]].cast<double>() - base;
    const double volume = a.dot(b.cross(c)) / 6;
    const Vector3 sum = a + b + c;
    result.volume_mm3 += volume;
    first += volume / 4 * sum;
    // Tetrahedron with one corner in the origin: integral of p p^T = V/20 (sum of squares of corners + square of sum).
    second += volume / 20 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
  }
  if (result.volume_mm3 == 0) return result;
  const double density_kg_mm3 = density_kg_m3 * 1e-9;
  const Vector3 centre = first / result.volume_mm3;
  const Eigen::Matrix3d spread = second - result.volume_mm3 * centre * centre.transpose();
  result.mass_kg = density_kg_mm3 * result.volume_mm3;
  result.centre_mm = base + centre;
  result.inertia_kg_mm2 = density_kg_mm3 * (spread.trace() * Eigen::Matrix3d::Identity() - spread);
  return result;
}

MassProperties with_mass(const MassProperties& properties, double mass_kg) {
  MassProperties result = properties;
  result.inertia_kg_mm2 *= mass_kg / properties.mass_kg;
  result.mass_kg = mass_kg;
  return result;
}

}  // namespace binrig
