// A world: kinds of part, the parts that lie there, bins, sensors and lights. Read from worlds/*.yaml:
//
//   name: bin-of-cylinders
//   renderer: auto                      # or embree, osmesa
//   parts:                              # kinds; obj_id 1, 2, ... in this order
//     - name: cylinder                  # default: the part's or file's name
//       part: cylinder                  # built in (sim/part_models.h); or mesh: FILE with unit: mm | cm | m | inch
//       surfaces:                       # one for all, or one per sub-mesh of the file, in its order
//         - {albedo: 0.4, specular: 0.6, shininess: 20, rgb: [0.5, 0.55, 0.6]}
//         - {albedo: 0.5, half_space: [0, 0, 1, 0]}   # the triangles where n . p > offset (mm): half polished, half
//         rough
//       symmetries_discrete: [...]      # BOP's keys of models_info.json; built-in parts know theirs
//       symmetries_continuous: [{axis: [0, 0, 1], offset: [0, 0, 0]}]
//       count: 18                       # how many fall into the bin; or
//       poses: [{translation: [0, 0, 20], rotation_vector_deg: [90, 0, 0]}]   # where they lie (X_WO)
//       density: 7850                   # kg/m^3, or mass: 0.1 (kg)
//       friction: 0.4
//       restitution: 0.3
//       rolling_resistance: 0.2         # mm
//       collision: pieces               # or hull: the convex hull of the mesh stands for the part
//   bins:
//     - name: left
//       inner_size: [210, 160, 80]      # height 0: a tray without walls
//       wall: 4
//       pose: {...}                     # upright: turned about z alone
//       surface: {albedo: 0.3}
//       friction: 0.4
//       restitution: 0.4
//       fill: {cylinder: 9, wrench: 9}  # parts by name; a part's count falls into the first bin besides
//       layout: {columns: 3, rows: 2, spacing: 70, height: 10, random_orientation: true,
//                jolt: 0.5}            # before and while they fall
//   physics:                            # see sim/stacking.h; every key may be absent
//     {gravity: 9810, step: 0.00104, iterations: 10, most_linear: 1000, most_angular: 50,
//      steady: {linear: 5, angular: 0.5, checks: 5, interval: 0.1, time_limit: 20}}
//   table: {height: 0, surface: {albedo: 0.4}}   # the plane z = height of the world
//   sensors:
//     - name: above
//       model: ../models/itri-2014.yaml # optional: --model counts where given
//       pose: {from: [0, 0, 800], at: [0, 0, 0], up: [0, 1, 0]}   # or poses: [...], one per scene, in turn
//       camera: {...}  projector: [100, 0, 0]  range: [700, 900]  frame_rate: 3   # where the model says "recording"
//   lights: [{position: [-300, -600, 900], intensity: 0.8}]
//   ambient: 0.25
//
// Frames: W = world, z up, B = bin (middle of its floor's upper face, z up), O = part, C = camera. Lengths in mm. A
// pose is translation with rotation_vector_deg, quaternion [w, x, y, z] or rotation_rows (9 numbers), or from/at/up of
// a camera.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frame_source.h"
#include "sim/part_models.h"
#include "sim/renderer.h"
#include "sim/stacking.h"

namespace binrig {

/// A kind of part.
struct WorldPart {
  PartModel model;
  std::string file;                              ///< the mesh file, "" for a built-in part
  int count = 0;                                 ///< how many are dropped into the first bin
  std::vector<Pose> X_WO;                        ///< those that lie where the file says
  std::optional<double> density_kg_m3, mass_kg;  ///< absent: 7850 kg/m^3 (steel)
  double friction = 0.4, restitution = 0.3, rolling_resistance_mm = 0.2;
  bool hull = false;  ///< collides as its convex hull
  std::string where;  ///< file:line, for messages
};

struct WorldBin {
  std::string name;
  Pose X_WB = Pose::Identity();
  Vector3 inner_size_mm = Vector3(210, 160, 80);
  double wall_mm = 4;
  double friction = 0.4, restitution = 0.4;
  Surface surface;
  std::shared_ptr<const Mesh> mesh;       ///< in B
  std::vector<std::pair<int, int>> fill;  ///< what falls into it: index into parts, how many
  DropLayout layout;
  std::string where;  ///< file:line, for messages
};

struct WorldSensor {
  std::string name;
  std::string model_file;        ///< "" = none
  std::vector<Pose> X_WC;        ///< one: fixed; more: a moving mount, one per scene, in turn
  std::optional<Camera> camera;  ///< where the model takes it from the "recording"
  SensorInfo info;               ///< projector, range, frame rate
};

/// One part at its place; what lies in the world at a moment.
struct WorldObject {
  int part = 0;  ///< index into parts
  Pose X_WO = Pose::Identity();
};

struct World {
  std::string name, file, renderer = "auto";
  std::vector<WorldPart> parts;
  std::vector<WorldBin> bins;
  std::vector<WorldSensor> sensors;
  struct Table {
    double height_mm = 0;
    Surface surface;
  };
  std::optional<Table> table;
  std::vector<RgbLight> lights;  ///< position in W
  float ambient = 0.25f;
  std::vector<WorldObject> objects;  ///< at first: every part's poses, in order; dropped parts join here
  StackingSettings physics;
  bool drops() const;  ///< something falls into a bin
};

/// Throws one Error with every violation, each with file:line: unknown keys, missing meshes and what load_mesh says of
/// them, inside-out meshes, numbers out of bounds, no sensor, poses that are none; of parts that fall: no solid, a
/// density that no material has, larger than their bin.
World read_world(const std::string& path);
World parse_world(const std::string& yaml_text, const std::string& name_for_messages, const std::string& folder = ".");

/// What a camera at X_WC sees: first the objects (instance k = objects[k-1]), then the bins (obj_id 0), then the table.
RenderScene render_scene(const World& world, const Pose& X_WC);

/// An open box of the given inside, in B: watertight, walls and floor `wall_mm` thick.
std::shared_ptr<const Mesh> bin_mesh(const Vector3& inner_size_mm, double wall_mm, const Surface& surface);

/// The camera at `from` (mm, W) that looks at `at`; `up` points to the image's upper side.
Pose look_at(const Vector3& from, const Vector3& at, const Vector3& up);

}  // namespace binrig
