#include "sim/world.h"

#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>

#include <yaml-cpp/yaml.h>

#include "core/error.h"
#include "core/sensor_model.h"
#include "core/yaml.h"
#include "sim/sdf_world.h"
#include "sim/world_physics.h"

namespace binrig {

namespace fs = std::filesystem;

namespace {
constexpr double far_mm = 1e5;
constexpr int most_parts = 10'000;

Vector3 vector3(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

std::optional<Vector3> read_vector(YamlMap& map, const std::string& key, double bound, const std::string& unit) {
  const auto v = map.numbers(key, 3, -bound, bound, unit);
  if (!v) return std::nullopt;
  return vector3(*v);
}

Surface read_surface(YamlMap& map) {
  Surface surface;
  surface.albedo = static_cast<float>(map.number("albedo", 0.5, 0, 1, "1"));
  surface.specular = static_cast<float>(map.number("specular", 0, 0, 1, "1"));
  surface.shininess = static_cast<float>(map.number("shininess", 30, 1, 10'000, "1"));
  if (const auto rgb = map.numbers("rgb", 3, 0, 1, "1")) {
    surface.rgb = {static_cast<float>((*rgb)[0]), static_cast<float>((*rgb)[1]), static_cast<float>((*rgb)[2])};
  } else {
    surface.rgb.fill(surface.albedo);
  }
  return surface;
}

Surface read_surface_of(YamlMap& parent, const std::string& key) {
  auto map = parent.map(key);
  if (!map) return Surface{};
  const Surface surface = read_surface(*map);
  map->finish();
  return surface;
}

Pose read_pose(YamlMap& map) {
  Pose X = Pose::Identity();
  if (map.has("from") || map.has("at")) {
    const auto from = read_vector(map, "from", far_mm, "mm"), at = read_vector(map, "at", far_mm, "mm");
    const Vector3 up = read_vector(map, "up", far_mm, "1").value_or(Vector3(0, 1, 0));
    if (!map.has("from")) map.missing("from", "[x, y, z], mm");
    if (!map.has("at")) map.missing("at", "[x, y, z], mm");
    if (from && at) {
      if ((*at - *from).cross(up).norm() < 1e-6 * (*at - *from).norm() || (*at - *from).norm() == 0) {
        map.violation("up", "lies along the viewing direction (or the camera looks at itself)");
      } else {
        X = look_at(*from, *at, up);
      }
    }
    map.finish();
    return X;
  }
  const Vector3 translation = read_vector(map, "translation", far_mm, "mm").value_or(Vector3::Zero());
  if (map.has("rotation_vector_deg") + map.has("quaternion") + map.has("rotation_rows") > 1) {
    map.violation("", "has more than one rotation");
  }
  if (const auto turn = read_vector(map, "rotation_vector_deg", 360, "deg")) {
    const double angle = turn->norm() * std::numbers::pi / 180;
    if (angle > 0) X = Pose(Eigen::AngleAxisd(angle, turn->normalized()));
  }
  if (const auto q = map.numbers("quaternion", 4, -1e3, 1e3, "1")) {
    const Eigen::Quaterniond rotation((*q)[0], (*q)[1], (*q)[2], (*q)[3]);
    if (rotation.norm() < 1e-6) {
      map.violation("quaternion", "is zero");
    } else {
      X = Pose(rotation.normalized());
    }
  }
  if (const auto rows = map.numbers("rotation_rows", 9, -1.001, 1.001, "1")) {
    try {
      X = pose_from_rows(rows->data(), Vector3::Zero().eval().data());
    } catch (const Error& problem) {
      map.violation("rotation_rows", problem.what());
    }
  }
  X.translation() = translation;
  map.finish();
  return X;
}

std::vector<Pose> read_poses(YamlMap& map, const std::string& one, const std::string& many) {
  std::vector<Pose> poses;
  if (auto pose = map.map(one)) poses.push_back(read_pose(*pose));
  for (YamlMap& pose : map.maps(many)) poses.push_back(read_pose(pose));
  return poses;
}

LengthUnit read_unit(YamlMap& map) {
  const std::string unit = map.text("unit", "mm", {"mm", "cm", "m", "inch"});
  return unit == "m"      ? LengthUnit::m
         : unit == "cm"   ? LengthUnit::cm
         : unit == "inch" ? LengthUnit::inch
                          : LengthUnit::mm;
}

// Replaces the mesh's surfaces as the file says; see the header for half_space.
void read_surfaces(YamlMap& map, std::shared_ptr<const Mesh>& mesh) {
  std::vector<YamlMap> list = map.maps("surfaces");
  if (list.empty() || !mesh) {
    for (YamlMap& entry : list) {
      read_surface(entry);
      entry.numbers("half_space", 4, -far_mm, far_mm, "mm");
      entry.finish();
    }
    return;
  }
  Mesh changed = *mesh;
  std::vector<Surface> whole;
  std::vector<std::pair<Surface, std::vector<double>>> halves;
  for (YamlMap& entry : list) {
    const Surface surface = read_surface(entry);
    const auto half_space = entry.numbers("half_space", 4, -far_mm, far_mm, "mm");
    entry.finish();
    if (half_space) {
      halves.emplace_back(surface, *half_space);
    } else {
      whole.push_back(surface);
    }
  }
  if (whole.size() == 1) {
    changed.surfaces.assign(changed.surfaces.size(), whole.front());
  } else if (whole.size() == changed.surfaces.size()) {
    changed.surfaces = whole;
  } else if (!whole.empty()) {
    map.violation("surfaces", "has " + std::to_string(whole.size()) + " entries, but the mesh has " +
                                  std::to_string(changed.surfaces.size()) + " sub-meshes");
    return;
  }
  mesh = std::make_shared<const Mesh>(std::move(changed));
  for (const auto& [surface, h] : halves) mesh = with_surface_beyond(*mesh, vector3(h), h[3], surface);
}

void read_symmetries(YamlMap& map, Symmetries& symmetries) {
  if (map.has("symmetries_discrete") || map.has("symmetries_continuous")) symmetries = {};
  const YAML::Node discrete = map.node("symmetries_discrete");
  if (discrete.IsDefined()) {
    for (const YAML::Node& entry : discrete) {
      std::vector<double> m;
      try {
        m = entry.as<std::vector<double>>();
      } catch (const YAML::Exception&) {
      }
      if (m.size() != 16) {
        map.violation("symmetries_discrete", "must be a list of 4 x 4 matrices, 16 numbers row by row");
        continue;
      }
      const double rows[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
      const double translation[3] = {m[3], m[7], m[11]};
      try {
        symmetries.discrete.push_back(pose_from_rows(rows, translation));
      } catch (const Error& problem) {
        map.violation("symmetries_discrete", problem.what());
      }
    }
  }
  for (YamlMap& entry : map.maps("symmetries_continuous")) {
    const auto axis = read_vector(entry, "axis", 1e3, "1");
    const Vector3 offset = read_vector(entry, "offset", far_mm, "mm").value_or(Vector3::Zero());
    if (!entry.has("axis")) entry.missing("axis", "[x, y, z]");
    if (axis && axis->norm() < 1e-9) entry.violation("axis", "is zero");
    if (axis && axis->norm() >= 1e-9) symmetries.continuous.push_back({axis->normalized(), offset});
    entry.finish();
  }
}

void read_mesh(YamlMap& map, const std::string& folder, WorldPart& part) {
  const auto built_in = map.text("part"), file = map.text("mesh");
  const LengthUnit unit = read_unit(map);
  if (built_in.has_value() == file.has_value()) {
    map.violation("", "needs either part: (a built-in one) or mesh: (a file)");
    return;
  }
  try {
    if (built_in) {
      part.model = part_model(*built_in);
    } else {
      part.file = (fs::path(folder) / *file).lexically_normal().string();
      part.model.mesh = load_mesh(part.file, unit);
      part.model.name = fs::path(part.file).stem().string();
    }
  } catch (const Error& problem) {
    map.violation(built_in ? "part" : "mesh",
                  problem.violations().empty() ? problem.what() : problem.violations().front().text());
    return;
  }
  const Closedness shape = closedness(*part.model.mesh);
  if (shape.closed && shape.volume_mm3 < 0) {
    map.violation("mesh", "its triangles are wound inside out (volume " + number_text(shape.volume_mm3) +
                              " mm^3): turn its normals round");
  }
}

WorldPart read_part(YamlMap& map, const std::string& folder) {
  WorldPart part;
  read_mesh(map, folder, part);
  read_surfaces(map, part.model.mesh);
  read_symmetries(map, part.model.symmetries);
  part.model.name = map.text("name", part.model.name);
  part.count = map.integer("count", 0, 0, most_parts);
  if (map.has("count") && part.count == 0) map.violation("count", "drops 0 parts: leave it out, or say how many");
  part.X_WO = read_poses(map, "pose", "poses");
  // What is no material is said together with the mass that it makes (check_physics).
  part.density_kg_m3 = map.number("density", 1e-12, 1e18, "kg/m^3");
  part.mass_kg = map.number("mass", 1e-9, 1e9, "kg");
  if (part.density_kg_m3 && part.mass_kg) map.violation("mass", "is given twice, with density");
  part.friction = map.number("friction", part.friction, 0, 5, "1");
  part.restitution = map.number("restitution", part.restitution, 0, 1, "1");
  part.rolling_resistance_mm = map.number("rolling_resistance", part.rolling_resistance_mm, 0, 100, "mm");
  part.hull = map.text("collision", "pieces", {"pieces", "hull"}) == "hull";
  part.where = map.where();
  map.finish();
  return part;
}

WorldBin read_bin(YamlMap& map, const std::vector<WorldPart>& parts) {
  WorldBin bin;
  bin.where = map.where();
  bin.name = map.text("name", "bin");
  if (auto pose = map.map("pose")) {
    bin.X_WB = read_pose(*pose);
    if (std::abs(bin.X_WB.linear()(2, 2) - 1) > 1e-6)
      map.violation("pose", "leans: a bin stands upright (it is tilted by its command)");
  }
  if (const auto size = map.numbers("inner_size", 3, 0, 5000, "mm")) {
    bin.inner_size_mm = vector3(*size);
    if (bin.inner_size_mm.x() < 1 || bin.inner_size_mm.y() < 1) map.violation("inner_size", "has no floor");
  }
  bin.wall_mm = map.number("wall", bin.wall_mm, 0.5, 500, "mm");
  bin.friction = map.number("friction", bin.friction, 0, 5, "1");
  bin.restitution = map.number("restitution", bin.restitution, 0, 1, "1");
  bin.surface = read_surface_of(map, "surface");
  bin.mesh = bin_mesh(bin.inner_size_mm, bin.wall_mm, bin.surface);
  if (auto fill = map.map("fill")) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      names.push_back(parts[i].model.name);
      // Asked for by name, so that what is left over is an unknown part.
      const int count = fill->integer(names.back(), 0, 0, most_parts);
      if (count > 0) bin.fill.emplace_back(static_cast<int>(i), count);
    }
    fill->finish();
    if (bin.fill.empty()) map.violation("fill", "drops 0 parts");
  }
  if (auto layout = map.map("layout")) {
    bin.layout.columns = layout->integer("columns", 0, 0, 1000);
    bin.layout.rows = layout->integer("rows", 0, 0, 1000);
    bin.layout.spacing_mm = layout->number("spacing", 0, 0, 5000, "mm");
    bin.layout.height_mm = layout->number("height", bin.layout.height_mm, 0, 5000, "mm");
    bin.layout.random_orientation = layout->boolean("random_orientation", true);
    bin.layout.jolt_gravities = layout->number("jolt", bin.layout.jolt_gravities, 0, 2, "g");
    layout->finish();
  }
  map.finish();
  return bin;
}

StackingSettings read_physics(YamlMap& map) {
  StackingSettings s;
  s.gravity_mm_s2 = map.number("gravity", s.gravity_mm_s2, 1, 1e6, "mm/s^2");
  s.step_s = map.number("step", s.step_s, 1e-5, 1.0 / 60, "s");
  s.iterations = map.integer("iterations", s.iterations, 1, 1000);
  s.most_linear_mm_s = map.number("most_linear", s.most_linear_mm_s, 1, 1e5, "mm/s");
  s.most_angular_rad_s = map.number("most_angular", s.most_angular_rad_s, 0.01, 1e3, "rad/s");
  if (auto steady = map.map("steady")) {
    s.steady.linear_mm_s = steady->number("linear", s.steady.linear_mm_s, 1e-3, 1e4, "mm/s");
    s.steady.angular_rad_s = steady->number("angular", s.steady.angular_rad_s, 1e-4, 1e3, "rad/s");
    s.steady.checks = steady->integer("checks", s.steady.checks, 1, 1000);
    s.steady.interval_s = steady->number("interval", s.steady.interval_s, 1e-3, 60, "s");
    s.steady.time_limit_s = steady->number("time_limit", s.steady.time_limit_s, 1e-2, 3600, "s");
    steady->finish();
  }
  map.finish();
  return s;
}

WorldSensor read_sensor(YamlMap& map, const std::string& folder) {
  WorldSensor sensor;
  sensor.name = map.text("name", "camera");
  if (const auto model = map.text("model")) {
    sensor.model_file = (fs::path(folder) / *model).lexically_normal().string();
    if (!fs::is_regular_file(sensor.model_file)) map.violation("model", "there is no file " + sensor.model_file);
  }
  sensor.X_WC = read_poses(map, "pose", "poses");
  if (sensor.X_WC.empty()) map.missing("pose", "where the camera is");
  if (auto camera = map.map("camera")) {
    sensor.camera = read_camera(*camera);
  }
  sensor.info.name = sensor.name;
  sensor.info.projector_xyz_mm = read_vector(map, "projector", far_mm, "mm");
  if (const auto range = map.numbers("range", 2, 1, far_mm, "mm")) sensor.info.range_mm = {(*range)[0], (*range)[1]};
  sensor.info.frame_rate_hz = map.number("frame_rate", 1e-3, 1e5, "Hz");
  map.finish();
  return sensor;
}

World read(const YAML::Node& root, const std::string& file, const std::string& folder) {
  Violations violations;
  YamlMap map(root, file, "", violations);
  World world;
  world.file = file;
  world.name = map.text("name", fs::path(file).stem().string());
  world.renderer = map.text("renderer", "auto", {"auto", "embree", "osmesa"});
  for (YamlMap& part : map.maps("parts")) world.parts.push_back(read_part(part, folder));
  for (YamlMap& bin : map.maps("bins")) world.bins.push_back(read_bin(bin, world.parts));
  if (auto physics = map.map("physics")) world.physics = read_physics(*physics);
  if (auto table = map.map("table")) {
    world.table = World::Table{table->number("height", 0, -far_mm, far_mm, "mm"), read_surface_of(*table, "surface")};
    table->finish();
  }
  for (YamlMap& sensor : map.maps("sensors")) world.sensors.push_back(read_sensor(sensor, folder));
  if (world.sensors.empty()) map.missing("sensors", "a world needs somebody who looks at it");
  for (YamlMap& light : map.maps("lights")) {
    RgbLight out;
    out.position_mm = read_vector(light, "position", far_mm, "mm").value_or(Vector3(-300, -600, 900));
    out.intensity = static_cast<float>(light.number("intensity", 0.8, 0, 100, "1"));
    light.finish();
    world.lights.push_back(out);
  }
  if (!map.has("lights")) world.lights.push_back({Vector3(-300, -600, 900), 0.8f});
  world.ambient = static_cast<float>(map.number("ambient", 0.25, 0, 10, "1"));
  map.finish();

  for (std::size_t i = 0; i < world.parts.size(); ++i) {
    for (const Pose& X_WO : world.parts[i].X_WO) world.objects.push_back({static_cast<int>(i), X_WO});
  }
  if (world.drops() && world.bins.empty()) map.missing("bins", "parts with a count need a bin to fall into");
  for (std::size_t i = 0; i < world.parts.size() && !world.bins.empty(); ++i) {
    if (world.parts[i].count > 0) world.bins.front().fill.emplace_back(static_cast<int>(i), world.parts[i].count);
  }
  check_physics(world, violations);
  if (world.objects.empty() && !world.drops() && world.bins.empty() && !world.table) {
    map.missing("parts", "there is nothing to see");
  }
  violations.throw_if_any("The world " + file + " cannot be used.");
  return world;
}
}  // namespace

bool World::drops() const {
  for (const WorldPart& part : parts) {
    if (part.count > 0) return true;
  }
  for (const WorldBin& bin : bins) {
    if (!bin.fill.empty()) return true;
  }
  return false;
}

World read_world(const std::string& path) {
  if (is_sdf(path)) return read_sdf_world(path);
  return read(load_yaml_file(path), path, fs::path(path).parent_path().string());
}

World parse_world(const std::string& yaml_text, const std::string& name_for_messages, const std::string& folder) {
  return read(parse_yaml(yaml_text, name_for_messages), name_for_messages, folder);
}

RenderScene render_scene(const World& world, const Pose& X_WC) {
  const Pose X_CW = X_WC.inverse();
  RenderScene scene;
  for (const WorldObject& object : world.objects) {
    scene.objects.push_back(
        {world.parts[static_cast<std::size_t>(object.part)].model.mesh, X_CW * object.X_WO, object.part + 1});
  }
  for (const WorldBin& bin : world.bins) scene.objects.push_back({bin.mesh, X_CW * bin.X_WB, 0});
  if (world.table) {
    const Vector3 normal = X_CW.linear() * Vector3(0, 0, 1);
    const Vector3 point = X_CW * Vector3(0, 0, world.table->height_mm);
    scene.plane = ScenePlane{normal, normal.dot(point), world.table->surface};
  }
  scene.lights.clear();
  for (const RgbLight& light : world.lights) scene.lights.push_back({X_CW * light.position_mm, light.intensity});
  scene.ambient = world.ambient;
  return scene;
}

std::shared_ptr<const Mesh> bin_mesh(const Vector3& inner_size_mm, double wall_mm, const Surface& surface) {
  Mesh mesh;
  const auto ring = [&](double half_x, double half_y, double z) {
    for (const auto& [x, y] : {std::pair(-1, -1), std::pair(1, -1), std::pair(1, 1), std::pair(-1, 1)}) {
      mesh.vertices.push_back({static_cast<float>(x * half_x), static_cast<float>(y * half_y), static_cast<float>(z)});
    }
  };
  const double x = inner_size_mm.x() / 2, y = inner_size_mm.y() / 2, height = inner_size_mm.z();
  ring(x + wall_mm, y + wall_mm, -wall_mm);
  ring(x + wall_mm, y + wall_mm, height);
  ring(x, y, height);
  ring(x, y, 0);
  for (std::uint32_t r = 0; r < 3; ++r) {  // outside, rim, inside: one ring joined to the next
    for (std::uint32_t i = 0; i < 4; ++i) {
      const std::uint32_t a = 4 * r + i, b = 4 * r + (i + 1) % 4;
      mesh.triangles.push_back({a, b, b + 4});
      mesh.triangles.push_back({a, b + 4, a + 4});
    }
  }
  mesh.triangles.insert(mesh.triangles.end(), {{12, 13, 14}, {12, 14, 15}, {0, 2, 1}, {0, 3, 2}});
  mesh.surfaces = {surface};
  mesh.name = "bin";
  mesh.content_hash = hash_of(mesh);
  return std::make_shared<const Mesh>(std::move(mesh));
}

Pose look_at(const Vector3& from, const Vector3& at, const Vector3& up) {
  Pose X_WC = Pose::Identity();
  const Vector3 z = (at - from).normalized();
  const Vector3 x = z.cross(up).normalized();  // x right where y is down: y = z x x points away from `up`
  X_WC.linear().col(0) = x;
  X_WC.linear().col(1) = z.cross(x);
  X_WC.linear().col(2) = z;
  X_WC.translation() = from;
  return X_WC;
}

}  // namespace binrig
