#include "sim/convex_hull.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <LinearMath/btConvexHullComputer.h>
#include <Eigen/Geometry>

namespace binrig {

double ConvexHull::outside_mm(const Vector3& p) const {
  double outside = -std::numeric_limits<double>::infinity();
  for (const HalfSpace& face : faces) outside = std::max(outside, face.outside_mm(p));
  return outside;
}

ConvexHull convex_hull(const std::vector<Vector3>& points) {
  ConvexHull hull;
  if (points.size() < 4) return hull;
  btConvexHullComputer computer;
  computer.compute(points.front().data(), static_cast<int>(sizeof(Vector3)), static_cast<int>(points.size()), 0, 0);
  hull.vertices.reserve(computer.vertices.size());
  // The computer works on a grid of integers; the points themselves are taken so that no rounding enters the hull.
  for (int i = 0; i < computer.vertices.size(); ++i) {
    hull.vertices.push_back(points[static_cast<std::size_t>(computer.original_vertex_index[i])]);
  }
  Vector3 centre = Vector3::Zero();
  for (const Vector3& v : hull.vertices) centre += v / static_cast<double>(hull.vertices.size());
  for (int f = 0; f < computer.faces.size(); ++f) {
    std::vector<int> loop;
    const auto* first = &computer.edges[computer.faces[f]];
    for (const auto* edge = first;;) {
      loop.push_back(edge->getSourceVertex());
      edge = edge->getNextEdgeOfFace();
      if (edge == first) break;
    }
    // Newell's normal: twice the area of the polygon, robust where single corners are nearly straight.
    Vector3 normal = Vector3::Zero(), middle = Vector3::Zero();
    for (std::size_t i = 0; i < loop.size(); ++i) {
      const Vector3& a = hull.vertices[loop[i]];
      const Vector3& b = hull.vertices[loop[(i + 1) % loop.size()]];
      normal += (a - centre).cross(b - centre);
      middle += a / static_cast<double>(loop.size());
    }
    if (normal.norm() < 1e-12) continue;
    normal.normalize();
    if (normal.dot(middle - centre) < 0) {
      normal = -normal;
      std::reverse(loop.begin(), loop.end());
    }
    double offset = -std::numeric_limits<double>::infinity();
    for (int i : loop) offset = std::max(offset, normal.dot(hull.vertices[i]));
    hull.faces.push_back({normal, offset});
    for (std::size_t i = 1; i + 1 < loop.size(); ++i) hull.triangles.push_back({loop[0], loop[i], loop[i + 1]});
  }
  for (const auto& t : hull.triangles) {
    hull.volume_mm3 +=
        (hull.vertices[t[0]] - centre).dot((hull.vertices[t[1]] - centre).cross(hull.vertices[t[2]] - centre)) / 6;
  }
  return hull;
}

ConvexHull simplified_hull(const ConvexHull& hull, double tolerance_mm) {
  if (hull.vertices.size() <= 12 || hull.triangles.empty()) return hull;
  std::vector<char> taken(hull.vertices.size(), 0);
  std::vector<Vector3> chosen;
  const auto take = [&](std::size_t i) {
    if (!taken[i]) chosen.push_back(hull.vertices[i]);
    taken[i] = 1;
  };
  const double directions[7][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}, {1, 1, -1}, {1, -1, 1}, {-1, 1, 1}};
  for (const auto& d : directions) {
    const Vector3 direction(d[0], d[1], d[2]);
    std::size_t low = 0, high = 0;
    for (std::size_t i = 1; i < hull.vertices.size(); ++i) {
      const double h = direction.dot(hull.vertices[i]);
      if (h < direction.dot(hull.vertices[low])) low = i;
      if (h > direction.dot(hull.vertices[high])) high = i;
    }
    take(low);
    take(high);
  }
  for (;;) {
    ConvexHull smaller = convex_hull(chosen);
    if (smaller.faces.empty()) return hull;
    // Of every face the vertex furthest outside it, so that the hull grows on all sides at once.
    std::vector<std::size_t> furthest(smaller.faces.size(), 0);
    std::vector<double> distance(smaller.faces.size(), tolerance_mm);
    for (std::size_t i = 0; i < hull.vertices.size(); ++i) {
      if (taken[i]) continue;
      std::size_t worst = 0;
      for (std::size_t f = 1; f < smaller.faces.size(); ++f) {
        if (smaller.faces[f].outside_mm(hull.vertices[i]) > smaller.faces[worst].outside_mm(hull.vertices[i]))
          worst = f;
      }
      const double outside = smaller.faces[worst].outside_mm(hull.vertices[i]);
      if (outside > distance[worst]) {
        distance[worst] = outside;
        furthest[worst] = i;
      }
    }
    bool grown = false;
    for (std::size_t f = 0; f < smaller.faces.size(); ++f) {
      if (distance[f] > tolerance_mm) {
        take(furthest[f]);
        grown = true;
      }
    }
    if (!grown) return smaller;
  }
}

}  // namespace binrig
