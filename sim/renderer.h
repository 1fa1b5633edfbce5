// One renderer interface. Implementations: OSMesa (rasterising, shaders that run unchanged on a GPU), Embree (ray
// casting, exact), and an analytic plane that needs neither. They are each other's check.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/channels.h"
#include "core/pose.h"
#include "sim/mesh.h"

namespace binrig {

struct SceneObject {
  std::shared_ptr<const Mesh> mesh;
  Pose X_CO = Pose::Identity();  ///< pose of the object in the camera frame, mm
  int obj_id = 0;
};

/// An infinite plane n . p = d in the camera frame (mm), seen from both sides; the backdrop that has no mesh.
struct ScenePlane {
  Vector3 normal = Vector3(0, 0, -1);  ///< unit
  double offset_mm = -800;             ///< d; here: 800 mm in front of the camera, facing it
  Surface surface;
};

/// A point light for RGB, camera frame.
struct RgbLight {
  Vector3 position_mm = Vector3(-300, -600, 0);
  float intensity = 0.8f;
};

/// Channels::instance is 1 + the index into objects; the plane gets objects.size() + 1.
struct RenderScene {
  std::vector<SceneObject> objects;
  std::optional<ScenePlane> plane;
  std::vector<RgbLight> lights{RgbLight{}};
  float ambient = 0.25f;
};

struct RenderRequest {
  Camera camera;                            ///< lens distortion is honoured
  std::optional<Vector3> projector_xyz_mm;  ///< camera frame; absent: no projector channels but diffuse and specular
                                            ///< as if it stood at the camera
  double reference_distance_mm = 800;       ///< z0 of the diffuse formula
  ChannelSet wanted = static_cast<ChannelSet>(Channel::depth);
  /// Refuse a camera inside a closed mesh. Switch off where the mesh is a room.
  bool check_inside = true;
};

class Renderer {
 public:
  virtual ~Renderer() = default;
  virtual std::string name() const = 0;
  /// Thread-safe. Throws Error if the scene cannot be rendered (a shader that does not compile, no plane for the
  /// analytic renderer, the camera inside a mesh when `check_inside`).
  virtual std::shared_ptr<const Channels> render(const RenderScene& scene, const RenderRequest& request) const = 0;
};

/// "embree", "osmesa", "plane" or "auto" (plane where the scene is a plane alone; else the faster one on this machine).
/// Throws Error for an unknown name or one that this build lacks.
std::unique_ptr<Renderer> make_renderer(const std::string& name = "auto");

}  // namespace binrig
