// Parts of about 50 mm made by our own code: watertight meshes with known symmetries, and the shapes they are made of.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/pose.h"
#include "sim/mesh.h"

namespace binrig {

/// Poses of the object that look the same, as BOP's models_info.json has them (mm, frame O of the mesh).
struct Symmetries {
  struct Axis {
    Vector3 direction = Vector3(0, 0, 1);  ///< unit
    Vector3 offset_mm = Vector3::Zero();   ///< a point on the axis
  };
  std::vector<Pose> discrete;    ///< symmetries_discrete: p and X * p look the same; without the identity
  std::vector<Axis> continuous;  ///< symmetries_continuous: turns by any angle
};

struct PartModel {
  std::string name;
  std::shared_ptr<const Mesh> mesh;
  Symmetries symmetries;
};

/// "bracket", "box", "cylinder", "socket", "sphere", "wrench". The origin is the centre of the bounding box.
std::vector<std::string> part_names();
/// Throws Error for an unknown name, naming the nearest one.
PartModel part_model(const std::string& name, const Surface& surface = Surface{});

/// Axis z, centred. `segments` around; watertight; outward winding, as for all of these.
std::shared_ptr<const Mesh> cylinder_mesh(double radius_mm, double length_mm, int segments, const Surface& surface);
std::shared_ptr<const Mesh> sphere_mesh(double radius_mm, int segments, const Surface& surface);
/// A tube along z with a polygonal or round bore: `bore_corners` corners on the radius `bore_mm`, which divides
/// `segments`.
std::shared_ptr<const Mesh> tube_mesh(double radius_mm, double bore_mm, double length_mm, int segments,
                                      int bore_corners, const Surface& surface);
/// A simple polygon (mm, counter-clockwise, not necessarily convex) from z = -height/2 to height/2.
std::shared_ptr<const Mesh> prism_mesh(const std::vector<Eigen::Vector2d>& outline, double height_mm,
                                       const Surface& surface);

/// The same surface in more triangles: each is cut into four until there are at least `triangles`.
std::shared_ptr<const Mesh> subdivided(const Mesh& mesh, std::size_t triangles);

/// The same solid with another surface where n . p > offset (mm, frame O): triangles that cross that plane are cut at
/// it, so that the border is straight. The mesh stays watertight.
std::shared_ptr<const Mesh> with_surface_beyond(const Mesh& mesh, const Vector3& n, double offset_mm,
                                                const Surface& surface);

/// Largest distance between two vertices (mm), as BOP defines a model's diameter. Exact, by the convex extremes along
/// many directions for meshes of more than 2000 vertices (then to 0.1 %).
double diameter_mm(const Mesh& mesh);

/// Whether every edge belongs to exactly two triangles that run along it in opposite directions, and the volume inside
/// (mm^3; negative where the triangles are wound inside out; meaningless for an open mesh).
struct Closedness {
  bool closed = false;
  double volume_mm3 = 0;
};
Closedness closedness(const Mesh& mesh);

}  // namespace binrig
