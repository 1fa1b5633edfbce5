// What a triangle mesh weighs and how it turns, and whether it bounds a solid at all.
//
// Volume, centre and inertia by summing signed tetrahedra (Mirtich, "Fast and accurate computation of polyhedral mass
// properties", J. Graphics Tools 1996, gives the same integrals over faces; tetrahedra are shorter to write).
#pragma once

#include <string>

#include <Eigen/Core>

#include "core/error.h"
#include "core/pose.h"
#include "sim/mesh.h"

namespace binrig {

struct MassProperties {
  double volume_mm3 = 0;
  double mass_kg = 0;
  Vector3 centre_mm = Vector3::Zero();                       ///< centre of mass in the mesh's frame O
  Eigen::Matrix3d inertia_kg_mm2 = Eigen::Matrix3d::Zero();  ///< about the centre of mass, axes of O
};

/// Densities that a part can be made of: from balsa wood to osmium.
inline constexpr double lowest_density_kg_m3 = 50, highest_density_kg_m3 = 23000;

/// Reports everything that keeps the mesh from being a solid: open edges (how many, and where the first are), edges of
/// more than two triangles, triangles wound against their neighbours, all of them wound inwards, no volume.
void check_solid(const Mesh& mesh, const std::string& where, Violations& violations);

/// Reports a density (kg/m^3) that no material has, with the mass that it would give to this volume.
void check_density(double density_kg_m3, double volume_mm3, const std::string& where, const std::string& key,
                   Violations& violations);

/// The mesh must have passed check_solid; the result of an open mesh means nothing.
MassProperties mass_properties(const Mesh& mesh, double density_kg_m3);

/// The same body, with its mass given instead: everything but the volume is scaled.
MassProperties with_mass(const MassProperties& properties, double mass_kg);

/// A solid enclosing the same volume turned inside out has a negative one.
double signed_volume_mm3(const Mesh& mesh);

}  // namespace binrig
