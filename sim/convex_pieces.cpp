#include "sim/convex_pieces.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include <Eigen/Geometry>

#include "sim/convex_hull.h"
#include "sim/mass_properties.h"

namespace binrig {
namespace {

// Folds flatter than this need no cut of their own (the facets of a bore of 64 segments fold by 5.6 degrees).
constexpr double least_fold_rad = 0.03;
constexpr int most_candidates = 72, slices_per_axis = 5;
// Two planes closer than this (share of the part's size, and cosine of the angle) are one candidate.
constexpr double same_offset = 0.01, same_cosine = 0.9986;

/// A triangle of the boundary. `cap` triangles close a cut: a fan from any point of the cutting plane, signed, so
/// that volumes come out right without joining the cut's edges into loops. Their corners belong to no hull: what they
/// span is spanned by the ends of the cut edges.
struct Facet {
  std::array<Vector3, 3> p;
  bool cap = false;
};

struct Portion {
  std::vector<Facet> facets;
  std::vector<HalfSpace> cuts;
  ConvexHull hull;
  double volume_mm3 = 0;
  bool final = false;
  double excess_mm3() const { return hull.volume_mm3 - volume_mm3; }
};

void measure(Portion& portion) {
  std::vector<Vector3> points;
  const Vector3 base = portion.facets.empty() ? Vector3::Zero() : portion.facets.front().p[0];
  portion.volume_mm3 = 0;
  for (const Facet& f : portion.facets) {
    portion.volume_mm3 += (f.p[0] - base).dot((f.p[1] - base).cross(f.p[2] - base)) / 6;
    if (!f.cap) points.insert(points.end(), f.p.begin(), f.p.end());
  }
  portion.hull = convex_hull(points);
}

/// The side of the plane where normal . p <= offset, measured; nothing if it is empty.
std::optional<Portion> cut_off(const Portion& whole, const HalfSpace& plane, double tiny_mm) {
  Portion side;
  side.cuts = whole.cuts;
  side.cuts.push_back(plane);
  const Vector3 hub = plane.normal * plane.offset_mm;
  const auto crossing = [&](const Vector3& a, double da, const Vector3& b, double db) {
    return Vector3(a + (b - a) * (da / (da - db)));
  };
  for (const Facet& f : whole.facets) {
    double d[3];
    int inside = 0;
    for (int k = 0; k < 3; ++k) {
      d[k] = plane.outside_mm(f.p[k]);
      if (std::abs(d[k]) < tiny_mm) d[k] = 0;
      inside += d[k] <= 0;
    }
    // A facet in the plane closes nothing that the caps of its neighbours' edges do not close.
    if (inside == 0 || (d[0] == 0 && d[1] == 0 && d[2] == 0)) continue;
    if (inside == 3) {
      side.facets.push_back(f);
      // An edge in the plane is where the section ends: it has a share in the cap as a crossing has.
      for (int k = 0; k < 3; ++k) {
        const int n = (k + 1) % 3, o = (k + 2) % 3;
        if (d[k] == 0 && d[n] == 0 && d[o] < 0) side.facets.push_back({{hub, f.p[n], f.p[k]}, true});
      }
      continue;
    }
    std::vector<Vector3> polygon;
    std::optional<Vector3> leaves, enters;
    for (int k = 0; k < 3; ++k) {
      const int n = (k + 1) % 3;
      if (d[k] <= 0) polygon.push_back(f.p[k]);
      if (d[k] <= 0 && d[n] > 0) {
        leaves = d[k] == 0 ? f.p[k] : crossing(f.p[k], d[k], f.p[n], d[n]);
        if (d[k] < 0) polygon.push_back(*leaves);
      } else if (d[k] > 0 && d[n] <= 0) {
        enters = d[n] == 0 ? f.p[n] : crossing(f.p[k], d[k], f.p[n], d[n]);
        if (d[n] < 0) polygon.push_back(*enters);
      }
    }
    for (std::size_t i = 2; i < polygon.size(); ++i) {
      side.facets.push_back({{polygon[0], polygon[i - 1], polygon[i]}, f.cap});
    }
    // The boundary runs from `leaves` to `enters` outside; the cap closes it along the plane, the other way round.
    if (polygon.size() >= 3 && leaves && enters) side.facets.push_back({{hub, *enters, *leaves}, true});
  }
  measure(side);
  if (side.hull.triangles.empty() || side.volume_mm3 <= 0) return std::nullopt;
  return side;
}

struct Fold {
  Vector3 a, b, n1, n2;
};

/// The concave edges of a solid.
std::vector<Fold> concave_folds(const Mesh& mesh) {
  const auto point = [&](std::uint32_t i) { return Vector3(mesh.vertices[i].cast<double>()); };
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> owner;  // directed edge -> triangle
  std::vector<Vector3> normals;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& c = mesh.triangles[t];
    normals.push_back((point(c[1]) - point(c[0])).cross(point(c[2]) - point(c[0])).normalized());
    for (int k = 0; k < 3; ++k) owner[{c[k], c[(k + 1) % 3]}] = t;
  }
  std::vector<Fold> folds;
  for (const auto& [edge, t] : owner) {
    if (edge.first > edge.second) continue;
    const auto other = owner.find({edge.second, edge.first});
    if (other == owner.end()) continue;
    const Vector3 &n1 = normals[t], &n2 = normals[other->second];
    const Vector3 along = (point(edge.second) - point(edge.first)).normalized();
    const double fold = std::atan2(n1.cross(n2).dot(along), n1.dot(n2));  // > 0 convex, with n1 on the left of the edge
    if (fold < -least_fold_rad) folds.push_back({point(edge.first), point(edge.second), n1, n2});
  }
  return folds;
}

/// Planes worth trying on a portion.
std::vector<HalfSpace> candidates(const Portion& portion, const std::vector<Fold>& folds, double size_mm) {
  std::vector<HalfSpace> planes;
  const auto add = [&](const Vector3& normal, const Vector3& through) {
    const HalfSpace plane{normal, normal.dot(through)};
    for (const HalfSpace& other : planes) {
      const double cosine = normal.dot(other.normal);
      const double offset = cosine > 0 ? other.offset_mm : -other.offset_mm;
      if (std::abs(cosine) > same_cosine && std::abs(offset - plane.offset_mm) < same_offset * size_mm) return;
    }
    planes.push_back(plane);
  };
  for (const Fold& fold : folds) {
    const Vector3 middle = (fold.a + fold.b) / 2;
    const bool here = std::all_of(portion.cuts.begin(), portion.cuts.end(),
                                  [&](const HalfSpace& cut) { return cut.outside_mm(middle) < -1e-6 * size_mm; });
    // A fold on the hull of the portion is no dent any more.
    if (!here || portion.hull.outside_mm(middle) > -1e-4 * size_mm) continue;
    add(fold.n1, middle);
    add(fold.n2, middle);
    const Vector3 half = (fold.b - fold.a).cross(fold.n1 + fold.n2);
    if (half.norm() > 1e-9) add(half.normalized(), middle);
  }
  if (planes.size() > most_candidates) {
    std::vector<HalfSpace> fewer;
    for (int i = 0; i < most_candidates; ++i) fewer.push_back(planes[planes.size() * i / most_candidates]);
    planes = fewer;
  }
  Vector3 low = portion.hull.vertices.front(), high = low;
  for (const Vector3& v : portion.hull.vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (int i = 1; i <= slices_per_axis; ++i) add(Vector3::Unit(axis), low + (high - low) * i / (slices_per_axis + 1));
  }
  return planes;
}

double size_of(const Mesh& mesh) {
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  return double{(high - low).norm()};
}

/// A hull of many points on a sphere is meant as a ball, and rolls like one.
std::optional<ConvexPiece> ball_of(const ConvexHull& hull) {
  if (hull.vertices.size() < 60) return std::nullopt;
  Vector3 centre = Vector3::Zero();
  double low = std::numeric_limits<double>::infinity(), high = 0;
  Vector3 least = hull.vertices.front(), most = least;
  for (const Vector3& v : hull.vertices) {
    least = least.cwiseMin(v);
    most = most.cwiseMax(v);
  }
  centre = (least + most) / 2;
  for (const Vector3& v : hull.vertices) {
    low = std::min(low, (v - centre).norm());
    high = std::max(high, (v - centre).norm());
  }
  // The volume tells a ball from points on one that leave part of it out.
  const double radius = std::cbrt(hull.volume_mm3 * 3 / (4 * M_PI));
  if (high - low > 0.002 * high || radius < 0.99 * high) return std::nullopt;
  return ConvexPiece{{centre}, (radius + high) / 2};
}

ConvexPiece piece_of(const ConvexHull& hull, const DecompositionSettings& settings) {
  if (auto ball = ball_of(hull)) return *ball;
  return {simplified_hull(hull, settings.simplify_mm).vertices, 0};
}

double distance_to_triangle(const Vector3& p, const Vector3& a, const Vector3& b, const Vector3& c) {
  const Vector3 n = (b - a).cross(c - a);
  if (n.squaredNorm() > 0) {
    const bool inside =
        (b - a).cross(p - a).dot(n) >= 0 && (c - b).cross(p - b).dot(n) >= 0 && (a - c).cross(p - c).dot(n) >= 0;
    if (inside) return std::abs((p - a).dot(n)) / n.norm();
  }
  const auto to_edge = [&](const Vector3& s, const Vector3& e) {
    const double length2 = (e - s).squaredNorm();
    const double t = length2 > 0 ? std::clamp((p - s).dot(e - s) / length2, 0.0, 1.0) : 0.0;
    return (p - s - t * (e - s)).norm();
  };
  return std::min({to_edge(a, b), to_edge(b, c), to_edge(c, a)});
}

/// Solid angle of the whole surface seen from p over 4 pi: 1 inside, 0 outside (van Oosterom and Strackee, 1983).
double winding_number(const Vector3& p, const Mesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vector3 a = mesh.vertices[t[0]].cast<double>() - p, b = mesh.vertices[t[1]].cast<double>() - p,
                  c = mesh.vertices[t[2]].cast<double>() - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    sum += std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return sum / (2 * M_PI);
}

double outside_distance(const Vector3& p, const Mesh& mesh) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& t : mesh.triangles) {
    nearest =
        std::min(nearest, distance_to_triangle(p, mesh.vertices[t[0]].cast<double>(),
                                               mesh.vertices[t[1]].cast<double>(), mesh.vertices[t[2]].cast<double>()));
  }
  return winding_number(p, mesh) > 0.5 ? 0 : nearest;
}

}  // namespace

ConvexPieces convex_pieces(const Mesh& mesh, const DecompositionSettings& settings) {
  const double size = size_of(mesh);
  const std::vector<Fold> folds = concave_folds(mesh);
  Portion whole;
  for (const auto& t : mesh.triangles) {
    whole.facets.push_back(
        {{mesh.vertices[t[0]].cast<double>(), mesh.vertices[t[1]].cast<double>(), mesh.vertices[t[2]].cast<double>()},
         false});
  }
  measure(whole);
  const double good_enough = settings.excess_volume * whole.volume_mm3;
  std::vector<Portion> portions{whole};
  while (static_cast<int>(portions.size()) < settings.most_pieces) {
    const auto worst = std::max_element(portions.begin(), portions.end(), [](const Portion& a, const Portion& b) {
      return (a.final ? 0 : a.excess_mm3()) < (b.final ? 0 : b.excess_mm3());
    });
    if (worst->final || worst->excess_mm3() <= good_enough) break;
    double least = std::numeric_limits<double>::infinity();
    std::optional<std::pair<Portion, Portion>> best;
    for (const HalfSpace& plane : candidates(*worst, folds, size)) {
      auto low = cut_off(*worst, plane, 1e-7 * size);
      auto high = cut_off(*worst, {-plane.normal, -plane.offset_mm}, 1e-7 * size);
      if (!low || !high) continue;
      // Where two cuts are as good, the one into more equal halves: fat pieces make better contacts than slivers.
      const double sliver = std::abs(low->volume_mm3 - high->volume_mm3);
      const double score = std::max(0.0, low->excess_mm3()) + std::max(0.0, high->excess_mm3()) + 0.02 * sliver;
      if (score < least) {
        least = score;
        best.emplace(std::move(*low), std::move(*high));
      }
    }
    if (!best) {
      worst->final = true;
      continue;
    }
    *worst = std::move(best->first);
    portions.push_back(std::move(best->second));
  }
  ConvexPieces result;
  for (const Portion& portion : portions) result.pieces.push_back(piece_of(portion.hull, settings));
  result.quality = pieces_quality(mesh, result.pieces);
  return result;
}

ConvexPieces hull_piece(const Mesh& mesh, const DecompositionSettings& settings) {
  std::vector<Vector3> points;
  for (const auto& v : mesh.vertices) points.push_back(v.cast<double>());
  ConvexPieces result;
  result.pieces = {piece_of(convex_hull(points), settings)};
  result.quality = pieces_quality(mesh, result.pieces);
  return result;
}

PiecesQuality pieces_quality(const Mesh& mesh, const std::vector<ConvexPiece>& pieces) {
  PiecesQuality quality;
  const double spacing = 0.015 * size_of(mesh);
  double volume = 0;
  for (const ConvexPiece& piece : pieces) {
    if (piece.points.size() == 1) {
      volume += 4.0 / 3 * M_PI * std::pow(piece.radius_mm, 3);
      for (int i = 0; i < 1000; ++i) {  // a Fibonacci lattice on the ball
        const double z = 1 - (2 * i + 1) / 1000.0, a = i * M_PI * (3 - std::sqrt(5.0)), r = std::sqrt(1 - z * z);
        const Vector3 p = piece.points[0] + piece.radius_mm * Vector3(r * std::cos(a), r * std::sin(a), z);
        quality.hausdorff_mm = std::max(quality.hausdorff_mm, outside_distance(p, mesh));
      }
      continue;
    }
    const ConvexHull hull = convex_hull(piece.points);
    volume += hull.volume_mm3;
    for (const auto& t : hull.triangles) {
      const Vector3 &a = hull.vertices[t[0]], &b = hull.vertices[t[1]], &c = hull.vertices[t[2]];
      // As many points as the area asks for, evenly spread (Roberts' sequence folded into the triangle).
      const double area = (b - a).cross(c - a).norm() / 2;
      const int count = static_cast<int>(area / (spacing * spacing)) + 1;
      for (int i = 0; i < count; ++i) {
        double u = std::fmod(0.5 + 0.7548776662466927 * i, 1.0), v = std::fmod(0.5 + 0.5698402909980532 * i, 1.0);
        if (u + v > 1) u = 1 - u, v = 1 - v;
        quality.hausdorff_mm = std::max(quality.hausdorff_mm, outside_distance(a + (b - a) * u + (c - a) * v, mesh));
      }
    }
  }
  const double solid = signed_volume_mm3(mesh);
  if (solid > 0) quality.volume_error = (volume - solid) / solid;
  return quality;
}

}  // namespace binrig
