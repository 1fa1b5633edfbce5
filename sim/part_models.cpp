#include "sim/part_models.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>

#include "core/error.h"

namespace binrig {

namespace {
using std::numbers::pi;
using Triangle = std::array<std::uint32_t, 3>;

std::shared_ptr<const Mesh> finished(Mesh mesh, const std::string& name, const Surface& surface) {
  mesh.name = name;
  mesh.surfaces = {surface};
  mesh.content_hash = hash_of(mesh);
  return std::make_shared<const Mesh>(std::move(mesh));
}

std::uint32_t add_vertex(Mesh& mesh, double x, double y, double z) {
  mesh.vertices.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
  return static_cast<std::uint32_t>(mesh.vertices.size() - 1);
}

void add_quad(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
  mesh.triangles.push_back({a, b, c});
  mesh.triangles.push_back({a, c, d});
}

std::vector<Eigen::Vector2d> circle(double radius, int points) {
  std::vector<Eigen::Vector2d> out;
  for (int i = 0; i < points; ++i) {
    out.emplace_back(radius * std::cos(2 * pi * i / points), radius * std::sin(2 * pi * i / points));
  }
  return out;
}

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

// Triangles of a simple polygon by cutting ears; quadratic, for outlines of a few hundred corners.
std::vector<Triangle> triangulated(const std::vector<Eigen::Vector2d>& p) {
  std::vector<std::uint32_t> left(p.size());
  for (std::size_t i = 0; i < p.size(); ++i) left[i] = static_cast<std::uint32_t>(i);
  std::vector<Triangle> out;
  while (left.size() > 2) {
    bool cut = false;
    for (std::size_t i = 0; i < left.size() && !cut; ++i) {
      const auto a = left[(i + left.size() - 1) % left.size()], b = left[i], c = left[(i + 1) % left.size()];
      if (cross(p[b] - p[a], p[c] - p[b]) <= 0) continue;
      const bool free = std::none_of(left.begin(), left.end(), [&](std::uint32_t q) {
        return q != a && q != b && q != c && cross(p[b] - p[a], p[q] - p[a]) >= 0 &&
               cross(p[c] - p[b], p[q] - p[b]) >= 0 && cross(p[a] - p[c], p[q] - p[c]) >= 0;
      });
      if (!free) continue;
      out.push_back({a, b, c});
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(i));
      cut = true;
    }
    if (!cut) throw Error("This outline is not a simple counter-clockwise polygon.");
  }
  return out;
}

Pose turn(const Vector3& axis, double angle_rad) { return Pose(Eigen::AngleAxisd(angle_rad, axis)); }

// Open-ended wrench, 50 mm: a shank of 6 mm, a jaw of 10 mm open to +x, a round end with a fillet-free neck.
std::vector<Eigen::Vector2d> wrench_outline() {
  const double shank = 3, head = 9, jaw = 5, head_x = 14, tail = 5, tail_x = -18;
  std::vector<Eigen::Vector2d> p;
  const double neck = std::asin(shank / head);  // where the head's circle meets the shank
  const double mouth = std::asin(jaw / head);
  // Counter-clockwise from the lower side of the neck round the head to the mouth.
  const int steps = 14;
  for (int i = 0; i <= steps; ++i) {
    const double a = -pi + neck + (pi - neck - mouth) * i / steps;
    p.emplace_back(head_x + head * std::cos(a), head * std::sin(a));
  }
  p.emplace_back(head_x - 2, -jaw);
  p.emplace_back(head_x - 2, jaw);
  for (int i = 0; i <= steps; ++i) {
    const double a = mouth + (pi - neck - mouth) * i / steps;
    p.emplace_back(head_x + head * std::cos(a), head * std::sin(a));
  }
  const double tail_neck = std::asin(shank / tail);
  for (int i = 0; i <= steps; ++i) {
    const double a = tail_neck + (2 * pi - 2 * tail_neck) * i / steps;
    p.emplace_back(tail_x + tail * std::cos(a), tail * std::sin(a));
  }
  return p;
}

// L of 3 mm sheet, 50 mm along, legs of 30 and 22 mm, bent with an inner radius.
std::vector<Eigen::Vector2d> bracket_outline() {
  const double sheet = 3, radius = 2, leg_x = 30, leg_y = 22;
  std::vector<Eigen::Vector2d> p;
  const int steps = 8;
  for (int i = 0; i <= steps; ++i) {  // outside of the bend, about (radius + sheet, radius + sheet)
    const double a = pi + pi / 2 * i / steps, r = radius + sheet;
    p.emplace_back(r + r * std::cos(a), r + r * std::sin(a));
  }
  p.emplace_back(leg_x, 0);
  p.emplace_back(leg_x, sheet);
  for (int i = 0; i <= steps; ++i) {  // inside, back
    const double a = 1.5 * pi - pi / 2 * i / steps, r = radius + sheet;
    p.emplace_back(r + radius * std::cos(a), r + radius * std::sin(a));
  }
  p.emplace_back(sheet, leg_y);
  p.emplace_back(0, leg_y);
  for (auto& q : p) q -= Eigen::Vector2d(leg_x / 2, leg_y / 2);
  return p;
}

Mesh centred(const Mesh& mesh) {
  Mesh out = mesh;
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  for (auto& v : out.vertices) v -= (low + high) / 2;
  return out;
}
}  // namespace

std::vector<std::string> part_names() { return {"box", "bracket", "cylinder", "socket", "sphere", "wrench"}; }

PartModel part_model(const std::string& name, const Surface& surface) {
  const Vector3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  PartModel part{name, nullptr, {}};
  if (name == "box") {
    part.mesh = box_mesh({50, 30, 20}, surface);
    part.symmetries.discrete = {turn(x, pi), turn(y, pi), turn(z, pi)};
  } else if (name == "bracket") {
    part.mesh = prism_mesh(bracket_outline(), 50, surface);
    part.symmetries.discrete = {};  // its mirror image is no rotation
  } else if (name == "cylinder") {
    part.mesh = cylinder_mesh(10, 50, 64, surface);
    part.symmetries.continuous = {{z, Vector3::Zero()}};
    part.symmetries.discrete = {turn(x, pi)};
  } else if (name == "socket") {
    // A hexagonal bore through: turns by 60 degrees, and upside down.
    part.mesh = tube_mesh(13, 8, 40, 60, 6, surface);
    for (int i = 1; i < 6; ++i) part.symmetries.discrete.push_back(turn(z, pi / 3 * i));
    for (int i = 0; i < 6; ++i) part.symmetries.discrete.push_back(turn(z, pi / 3 * i) * turn(x, pi));
  } else if (name == "sphere") {
    part.mesh = sphere_mesh(20, 64, surface);
    part.symmetries.continuous = {{x, Vector3::Zero()}, {y, Vector3::Zero()}, {z, Vector3::Zero()}};
  } else if (name == "wrench") {
    part.mesh = prism_mesh(wrench_outline(), 5, surface);
    part.symmetries.discrete = {turn(x, pi)};
  } else {
    const std::string near = nearest_word(name, part_names());
    throw Error("There is no built-in part \"" + name + "\": box, bracket, cylinder, socket, sphere or wrench" +
                (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  part.mesh = finished(centred(*part.mesh), name, surface);
  return part;
}

std::shared_ptr<const Mesh> prism_mesh(const std::vector<Eigen::Vector2d>& outline, double height_mm,
                                       const Surface& surface) {
  Mesh mesh;
  const auto n = static_cast<std::uint32_t>(outline.size());
  for (double z : {-height_mm / 2, height_mm / 2}) {
    for (const auto& p : outline) add_vertex(mesh, p.x(), p.y(), z);
  }
  for (const Triangle& t : triangulated(outline)) {
    mesh.triangles.push_back({t[0], t[2], t[1]});
    mesh.triangles.push_back({n + t[0], n + t[1], n + t[2]});
  }
  for (std::uint32_t i = 0; i < n; ++i) add_quad(mesh, i, (i + 1) % n, n + (i + 1) % n, n + i);
  return finished(std::move(mesh), "prism", surface);
}

std::shared_ptr<const Mesh> cylinder_mesh(double radius_mm, double length_mm, int segments, const Surface& surface) {
  Mesh mesh;
  const auto n = static_cast<std::uint32_t>(segments);
  for (double z : {-length_mm / 2, length_mm / 2}) {
    for (const auto& p : circle(radius_mm, segments)) add_vertex(mesh, p.x(), p.y(), z);
  }
  const auto bottom = add_vertex(mesh, 0, 0, -length_mm / 2), top = add_vertex(mesh, 0, 0, length_mm / 2);
  for (std::uint32_t i = 0; i < n; ++i) {
    const auto j = (i + 1) % n;
    add_quad(mesh, i, j, n + j, n + i);
    mesh.triangles.push_back({bottom, j, i});
    mesh.triangles.push_back({top, n + i, n + j});
  }
  return finished(std::move(mesh), "cylinder", surface);
}

std::shared_ptr<const Mesh> sphere_mesh(double radius_mm, int segments, const Surface& surface) {
  Mesh mesh;
  const auto n = static_cast<std::uint32_t>(segments), rings = n / 2;
  for (std::uint32_t ring = 1; ring < rings; ++ring) {
    const double polar = pi * ring / rings;
    for (const auto& p : circle(radius_mm * std::sin(polar), segments)) {
      add_vertex(mesh, p.x(), p.y(), radius_mm * std::cos(polar));
    }
  }
  const auto north = add_vertex(mesh, 0, 0, radius_mm), south = add_vertex(mesh, 0, 0, -radius_mm);
  for (std::uint32_t i = 0; i < n; ++i) {
    const auto j = (i + 1) % n;
    mesh.triangles.push_back({north, i, j});
    for (std::uint32_t ring = 0; ring + 2 < rings; ++ring) {
      add_quad(mesh, ring * n + i, (ring + 1) * n + i, (ring + 1) * n + j, ring * n + j);
    }
    mesh.triangles.push_back({south, (rings - 2) * n + j, (rings - 2) * n + i});
  }
  return finished(std::move(mesh), "sphere", surface);
}

std::shared_ptr<const Mesh> tube_mesh(double radius_mm, double bore_mm, double length_mm, int segments,
                                      int bore_corners, const Surface& surface) {
  if (bore_corners < 3 || segments % bore_corners != 0) {
    throw Error("The bore's corners must divide the segments of the tube.");
  }
  Mesh mesh;
  const auto n = static_cast<std::uint32_t>(segments);
  const auto corners = circle(bore_mm, bore_corners);
  const int per_side = segments / bore_corners;
  for (double z : {-length_mm / 2, length_mm / 2}) {
    for (const auto& p : circle(radius_mm, segments)) add_vertex(mesh, p.x(), p.y(), z);
    for (int i = 0; i < segments; ++i) {
      const auto& a = corners[static_cast<std::size_t>(i / per_side)];
      const auto& b = corners[static_cast<std::size_t>((i / per_side + 1) % bore_corners)];
      const Eigen::Vector2d p = a + (b - a) * (i % per_side) / per_side;
      add_vertex(mesh, p.x(), p.y(), z);
    }
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    const auto j = (i + 1) % n;
    const auto outer = 0u, inner = n, top_outer = 2 * n, top_inner = 3 * n;
    add_quad(mesh, outer + i, outer + j, top_outer + j, top_outer + i);
    add_quad(mesh, inner + j, inner + i, top_inner + i, top_inner + j);
    add_quad(mesh, top_outer + i, top_outer + j, top_inner + j, top_inner + i);
    add_quad(mesh, outer + j, outer + i, inner + i, inner + j);
  }
  return finished(std::move(mesh), "tube", surface);
}

std::shared_ptr<const Mesh> subdivided(const Mesh& mesh, std::size_t triangles) {
  Mesh out = mesh;
  while (out.triangles.size() < triangles) {
    Mesh next;
    next.vertices = out.vertices;
    next.surfaces = out.surfaces;
    std::unordered_map<std::uint64_t, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const std::uint64_t key = (std::uint64_t{std::min(a, b)} << 32) | std::max(a, b);
      const auto [it, is_new] = middles.try_emplace(key, static_cast<std::uint32_t>(next.vertices.size()));
      if (is_new) next.vertices.push_back((out.vertices[a] + out.vertices[b]) / 2);
      return it->second;
    };
    for (std::size_t i = 0; i < out.triangles.size(); ++i) {
      const auto [a, b, c] = out.triangles[i];
      const auto ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      for (const Triangle& t : {Triangle{a, ab, ca}, Triangle{ab, b, bc}, Triangle{ca, bc, c}, Triangle{ab, bc, ca}}) {
        next.triangles.push_back(t);
        if (!out.triangle_surface.empty()) next.triangle_surface.push_back(out.triangle_surface[i]);
      }
    }
    next.name = out.name;
    out = std::move(next);
  }
  out.content_hash = hash_of(out);
  return std::make_shared<const Mesh>(std::move(out));
}

std::shared_ptr<const Mesh> with_surface_beyond(const Mesh& mesh, const Vector3& n, double offset_mm,
                                                const Surface& surface) {
  Mesh out;
  out.vertices = mesh.vertices;
  out.surfaces = mesh.surfaces;
  out.surfaces.push_back(surface);
  out.name = mesh.name;
  const auto other = static_cast<std::uint16_t>(mesh.surfaces.size());
  const auto side = [&](std::uint32_t v) { return n.dot(out.vertices[v].cast<double>()) - offset_mm; };
  std::unordered_map<std::uint64_t, std::uint32_t> cuts;
  const auto cut = [&](std::uint32_t a, std::uint32_t b) {
    const auto [low, high] = std::minmax(a, b);
    const auto [it, is_new] =
        cuts.try_emplace((std::uint64_t{low} << 32) | high, static_cast<std::uint32_t>(out.vertices.size()));
    if (is_new) {
      const double from = side(low), to = side(high);
      const Vector3 p = out.vertices[low].cast<double>(), q = out.vertices[high].cast<double>();
      out.vertices.push_back((p + (q - p) * (from / (from - to))).cast<float>());
    }
    return it->second;
  };
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const std::uint16_t own = mesh.triangle_surface.empty() ? std::uint16_t{0} : mesh.triangle_surface[i];
    const auto add = [&](const Triangle& t, bool beyond) {
      out.triangles.push_back(t);
      out.triangle_surface.push_back(beyond ? other : own);
    };
    Triangle t = mesh.triangles[i];
    std::array<bool, 3> beyond{};
    for (std::size_t k = 0; k < 3; ++k) beyond[k] = side(t[k]) > 0;
    if (beyond[0] == beyond[1] && beyond[1] == beyond[2]) {
      add(t, beyond[0]);
      continue;
    }
    // Turned until its first corner is the one that is alone on its side.
    while (beyond[1] != beyond[2]) {
      std::rotate(t.begin(), t.begin() + 1, t.end());
      std::rotate(beyond.begin(), beyond.begin() + 1, beyond.end());
    }
    const auto ab = cut(t[0], t[1]), ca = cut(t[2], t[0]);
    add({t[0], ab, ca}, beyond[0]);
    add({ab, t[1], t[2]}, beyond[1]);
    add({ab, t[2], ca}, beyond[1]);
  }
  out.content_hash = hash_of(out);
  return std::make_shared<const Mesh>(std::move(out));
}

double diameter_mm(const Mesh& mesh) {
  std::vector<Eigen::Vector3f> points = mesh.vertices;
  if (points.size() > 2000) {
    // Only extreme points can be farthest apart: keep those along directions spread evenly (a Fibonacci lattice).
    std::vector<Eigen::Vector3f> extremes;
    const int directions = 1000;
    for (int i = 0; i < directions; ++i) {
      const double z = 1 - (2.0 * i + 1) / directions, a = i * pi * (3 - std::sqrt(5.0)), r = std::sqrt(1 - z * z);
      const Eigen::Vector3f d(static_cast<float>(r * std::cos(a)), static_cast<float>(r * std::sin(a)),
                              static_cast<float>(z));
      extremes.push_back(*std::max_element(points.begin(), points.end(),
                                           [&](const auto& p, const auto& q) { return p.dot(d) < q.dot(d); }));
    }
    points = std::move(extremes);
  }
  float largest = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j)
      largest = std::max(largest, (points[i] - points[j]).squaredNorm());
  }
  return std::sqrt(double{largest});
}

Closedness closedness(const Mesh& mesh) {
  std::unordered_map<std::uint64_t, int> edges;  // +1 along, -1 against
  Closedness result;
  for (const auto& t : mesh.triangles) {
    const Vector3 a = mesh.vertices[t[0]].cast<double>(), b = mesh.vertices[t[1]].cast<double>(),
                  c = mesh.vertices[t[2]].cast<double>();
    result.volume_mm3 += a.dot(b.cross(c)) / 6;
    for (int i = 0; i < 3; ++i) {
      const std::uint64_t from = t[static_cast<std::size_t>(i)], to = t[static_cast<std::size_t>((i + 1) % 3)];
      edges[(std::min(from, to) << 32) | std::max(from, to)] += from < to ? 1 : -1;
    }
  }
  result.closed = std::all_of(edges.begin(), edges.end(), [](const auto& edge) { return edge.second == 0; });
  return result;
}

}  // namespace binrig
