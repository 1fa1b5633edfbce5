#include "sim/sdf_world.h"

#include <filesystem>

#include "core/error.h"

#ifdef BINRIG_HAVE_SDFORMAT
#include <map>
#include <sstream>

#include <fmt/format.h>
#include <sdf/sdf.hh>

#include "sim/world_physics.h"
#endif

namespace binrig {

bool is_sdf(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  return extension == ".sdf" || extension == ".world";
}

#ifndef BINRIG_HAVE_SDFORMAT

World read_sdf_world(const std::string& path) {
  throw Error("The world " + path + " cannot be read: this program was built without libsdformat (Debian's " +
              "libsdformat-dev); a world in YAML can.");
}

#else

namespace {
namespace fs = std::filesystem;

constexpr double mm_per_m = 1000;

Vector3 millimetres(const ignition::math::Vector3d& v) { return mm_per_m * Vector3(v.X(), v.Y(), v.Z()); }

Pose pose_of(const ignition::math::Pose3d& p) {
  Pose X = Pose::Identity();
  X.linear() = Eigen::Quaterniond(p.Rot().W(), p.Rot().X(), p.Rot().Y(), p.Rot().Z()).normalized().toRotationMatrix();
  X.translation() = millimetres(p.Pos());
  return X;
}

class Reader {
 public:
  Reader(World& world, Violations& violations) : world_(world), violations_(violations) {}

  void read(const sdf::World& sdf) {
    world_.name = sdf.Name();
    world_.physics.gravity_mm_s2 = sdf.Gravity().Length() * mm_per_m;
    for (std::uint64_t i = 0; i < sdf.ModelCount(); ++i) read(*sdf.ModelByIndex(i));
    if (world_.sensors.empty()) violations_.add(world_.file, "sensor", "is missing: a world needs a camera");
    for (std::size_t i = 0; i < world_.parts.size(); ++i) {
      const WorldPart& part = world_.parts[i];
      for (const Pose& X_WO : part.X_WO) world_.objects.push_back({static_cast<int>(i), X_WO});
      if (part.count == 0) continue;
      if (world_.bins.empty()) {
        violations_.add(part.where, "bin", "is missing: this model is not static and would fall for ever");
      } else {
        world_.bins.front().fill.emplace_back(static_cast<int>(i), part.count);
      }
    }
    check_physics(world_, violations_);
  }

 private:
  std::string where(const sdf::ElementPtr& element) const {
    const auto line = element ? element->LineNumber() : std::nullopt;
    return line ? world_.file + ":" + std::to_string(*line) : world_.file;
  }

  void read(const sdf::Model& model) {
    const std::string place = where(model.Element()) + ": model " + model.Name();
    const Pose X_WM = pose_of(model.RawPose());
    if (model.Element()->HasElement("binrig:bin")) {
      read_bin(*model.Element()->GetElement("binrig:bin"), model.Name(), X_WM, place);
      return;
    }
    bool seen = false;
    for (std::uint64_t l = 0; l < model.LinkCount(); ++l) {
      const sdf::Link& link = *model.LinkByIndex(l);
      const Pose X_WL = X_WM * pose_of(link.RawPose());
      for (std::uint64_t s = 0; s < link.SensorCount(); ++s) {
        read_sensor(*link.SensorByIndex(s), X_WL, place);
        seen = true;
      }
    }
    if (seen) return;
    if (model.LinkCount() != 1 || model.LinkByIndex(0)->CollisionCount() == 0) {
      violations_.add(place, "link", "must be one, with a collision");
      return;
    }
    const sdf::Link& link = *model.LinkByIndex(0);
    const sdf::Collision& collision = *link.CollisionByIndex(0);
    const Pose X_WO = X_WM * pose_of(link.RawPose()) * pose_of(collision.RawPose());
    if (collision.Geom()->Type() == sdf::GeometryType::PLANE) {
      world_.table = World::Table{X_WO.translation().z(), Surface{}};
      return;
    }
    WorldPart* part = part_of(model, link, collision, place);
    if (!part) return;
    if (model.Static()) {
      part->X_WO.push_back(X_WO);
    } else {
      ++part->count;
    }
  }

  /// The kind of this geometry, made when it is the first.
  WorldPart* part_of(const sdf::Model& model, const sdf::Link& link, const sdf::Collision& collision,
                     const std::string& place) {
    std::string key;
    const std::shared_ptr<const Mesh> mesh = mesh_of(*collision.Geom(), place, key);
    if (!mesh) return nullptr;
    const bool weighed =
        link.Element()->HasElement("inertial") && link.Element()->GetElement("inertial")->HasElement("mass");
    if (weighed) key += fmt::format(" {} kg", link.Inertial().MassMatrix().Mass());
    const auto [it, is_new] = kinds_.try_emplace(key, world_.parts.size());
    if (is_new) {
      WorldPart part;
      part.model = {model.Name(), mesh, {}};
      part.where = place;
      if (weighed) part.mass_kg = link.Inertial().MassMatrix().Mass();
      const sdf::ElementPtr element = collision.Element();
      if (element->HasElement("surface")) {
        const sdf::ElementPtr surface = element->GetElement("surface");
        if (surface->HasElement("friction") && surface->GetElement("friction")->HasElement("ode")) {
          part.friction = surface->GetElement("friction")->GetElement("ode")->Get<double>("mu", part.friction).first;
        }
        if (surface->HasElement("bounce")) {
          part.restitution =
              surface->GetElement("bounce")->Get<double>("restitution_coefficient", part.restitution).first;
        }
      }
      world_.parts.push_back(std::move(part));
    }
    return &world_.parts[it->second];
  }

  std::shared_ptr<const Mesh> mesh_of(const sdf::Geometry& geometry, const std::string& place, std::string& key) {
    if (const sdf::Box* box = geometry.BoxShape()) {
      const Vector3 size = millimetres(box->Size());
      key = fmt::format("box {} {} {}", size.x(), size.y(), size.z());
      return box_mesh(size, Surface{});
    }
    if (const sdf::Cylinder* cylinder = geometry.CylinderShape()) {
      key = fmt::format("cylinder {} {}", cylinder->Radius(), cylinder->Length());
      return cylinder_mesh(cylinder->Radius() * mm_per_m, cylinder->Length() * mm_per_m, 64, Surface{});
    }
    if (const sdf::Sphere* sphere = geometry.SphereShape()) {
      key = fmt::format("sphere {}", sphere->Radius());
      return sphere_mesh(sphere->Radius() * mm_per_m, 64, Surface{});
    }
    const sdf::Mesh* mesh = geometry.MeshShape();
    if (!mesh) {
      violations_.add(place, "geometry", "is none that binrig knows: mesh, box, cylinder, sphere, plane");
      return nullptr;
    }
    const auto scheme = mesh->Uri().find("://");
    const std::string relative = scheme == std::string::npos ? mesh->Uri() : mesh->Uri().substr(scheme + 3);
    const std::string file = (fs::path(world_.file).parent_path() / relative).lexically_normal().string();
    if (!fs::is_regular_file(file)) {
      violations_.add({place, "uri", mesh->Uri(), "", "", "is missing: there is no file " + file});
      return nullptr;
    }
    const auto scale = mesh->Scale();
    key = fmt::format("{} {} {} {}", file, scale.X(), scale.Y(), scale.Z());
    try {
      // SDFormat's meshes are in metres times their scale. A file in millimetres has the scale 0.001: read as what it
      // is, so that it does not look as if it had the wrong unit.
      const bool in_mm = scale.X() == 0.001 && scale.Y() == 0.001 && scale.Z() == 0.001;
      const auto loaded = load_mesh(file, in_mm ? LengthUnit::mm : LengthUnit::m);
      if (in_mm || scale == ignition::math::Vector3d::One) return loaded;
      Mesh scaled = *loaded;
      for (auto& v : scaled.vertices) {
        v = v.cwiseProduct(Eigen::Vector3d(scale.X(), scale.Y(), scale.Z()).cast<float>());
      }
      scaled.content_hash = hash_of(scaled);
      return std::make_shared<const Mesh>(std::move(scaled));
    } catch (const Error& problem) {
      violations_.add(place, "uri", problem.what());
      return nullptr;
    }
  }

  void read_bin(sdf::Element& element, const std::string& name, const Pose& X_WB, const std::string& place) {
    WorldBin bin;
    bin.name = name;
    bin.X_WB = X_WB;
    bin.where = place;
    const auto number = [&](const std::string& key, int count) {
      std::vector<double> values;
      if (element.HasElement(key)) {
        std::istringstream in(element.GetElement(key)->Get<std::string>());
        for (double v; in >> v;) values.push_back(v * mm_per_m);
      }
      if (static_cast<int>(values.size()) != count || *std::min_element(values.begin(), values.end()) <= 0) {
        violations_.add(place, key, "must be " + std::to_string(count) + " positive numbers, m");
        values.assign(static_cast<std::size_t>(count), 100);
      }
      return values;
    };
    const auto size = number("binrig:inner_size", 3);
    bin.inner_size_mm = Vector3(size[0], size[1], size[2]);
    if (element.HasElement("binrig:wall")) bin.wall_mm = number("binrig:wall", 1)[0];
    bin.mesh = bin_mesh(bin.inner_size_mm, bin.wall_mm, bin.surface);
    world_.bins.push_back(std::move(bin));
  }

  void read_sensor(const sdf::Sensor& sensor, const Pose& X_WL, const std::string& place) {
    const sdf::Camera* camera = sensor.CameraSensor();
    if (!camera) {
      violations_.add(place, "sensor", sensor.Name() + " is no camera (it is a " + sensor.TypeStr() + ")");
      return;
    }
    WorldSensor out;
    out.name = sensor.Name();
    out.info.name = sensor.Name();
    // SDFormat looks along x with z up; we along z with y down.
    Pose turn = Pose::Identity();
    turn.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    out.X_WC = {X_WL * pose_of(sensor.RawPose()) * pose_of(camera->RawPose()) * turn};
    out.camera = camera_from_field_of_view(static_cast<int>(camera->ImageWidth()),
                                           static_cast<int>(camera->ImageHeight()), camera->HorizontalFov().Radian());
    if (sensor.UpdateRate() > 0) out.info.frame_rate_hz = sensor.UpdateRate();
    world_.sensors.push_back(std::move(out));
  }

  World& world_;
  Violations& violations_;
  std::map<std::string, std::size_t> kinds_;
};

}  // namespace

World read_sdf_world(const std::string& path) {
  if (!fs::is_regular_file(path)) throw Error("There is no world " + path + ".");
  // libsdformat also prints what it returns; it is said once, by the Error.
  sdf::Console::Instance()->SetQuiet(true);
  sdf::ParserConfig config;
  config.SetUnrecognizedElementsPolicy(sdf::EnforcementPolicy::ERR);
  config.SetWarningsPolicy(sdf::EnforcementPolicy::ERR);
  sdf::Root root;
  Violations violations;
  for (const sdf::Error& error : root.Load(path, config)) {
    const auto line = error.LineNumber();
    std::string text = error.Message();
    text.erase(text.find_last_not_of(" \n") + 1);
    violations.add(line ? path + ":" + std::to_string(*line) : path, "", text);
  }
  World world;
  world.file = path;
  world.lights = {{Vector3(-300, -600, 900), 0.8f}};
  if (root.WorldCount() == 1) {
    Reader(world, violations).read(*root.WorldByIndex(0));
  } else if (violations.empty()) {
    violations.add(path, "world", "must be one; there are " + std::to_string(root.WorldCount()));
  }
  violations.throw_if_any("The world " + path + " cannot be used.");
  return world;
}

#endif

}  // namespace binrig
