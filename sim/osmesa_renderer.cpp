// Rasterising with OpenGL shaders: which triangle each camera pixel sees, and which triangle each direction of a light
// meets (the shadow map). The shaders answer nothing else; shading.cpp intersects the exact ray with that triangle.
//
// The shadow map holds triangles instead of depths. A point is in shadow where the exact ray from the light goes
// through one of the triangles seen by the four texels around it, before the point: no depth bias, so no acne and no
// peter-panning, and shadow edges are those of the triangles, not of the texels.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <list>
#include <numeric>
#include <unordered_map>
#include <vector>

#define GL_GLEXT_PROTOTYPES
#include <GL/osmesa.h>
// After osmesa.h, which brings gl.h.
#include <GL/glext.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "sim/offscreen_gl.h"
#include "sim/part_models.h"
#include "sim/shading.h"

namespace binrig {

namespace {
constexpr std::size_t cached_meshes = 128;
constexpr int largest_raster = 8192;
constexpr float near_mm = 0.01f;          // reversed depth: a near plane this near costs no precision
constexpr double lens_oversampling = 2;   // raster pixels per pixel of a distorted camera
constexpr double map_oversampling = 1.5;  // texels of the shadow map per camera pixel
constexpr double beyond_triangle_mm = 1;
constexpr int band_rows = 8;

const char* const vertex_shader = R"(#version 450 core
layout(location = 0) in vec3 p_O;
uniform mat4 clip_from_O;
void main() { gl_Position = clip_from_O * vec4(p_O, 1.0); }
)";
const char* const fragment_shader = R"(#version 450 core
layout(location = 0) out uvec2 seen;
uniform uint object;
void main() { seen = uvec2(object, uint(gl_PrimitiveID)); }
)";

/// A pinhole picture of what is seen: pixel centre (i, j) shows the direction (x0 + i dx, y0 + j dy, 1) of its frame.
struct Raster {
  int width = 0, height = 0;
  double x0 = 0, y0 = 0, dx = 0, dy = 0;
};

/// (object, triangle) a pixel; object 0 = nothing.
struct Picture {
  Raster raster;
  cv::Mat seen;  // CV_32SC2
  const cv::Vec2i& at(int row, int col) const { return seen.at<cv::Vec2i>(row, col); }
};

/// +1 (-1) where every connected piece of the mesh is closed and has a positive (negative) volume; else 0.
int outside_of(const Mesh& mesh) {
  if (!closedness(mesh).closed) return 0;
  std::vector<std::uint32_t> root(mesh.vertices.size());
  std::iota(root.begin(), root.end(), 0u);
  const auto find = [&](std::uint32_t v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  for (const auto& t : mesh.triangles) {
    root[find(t[0])] = find(t[1]);
    root[find(t[1])] = find(t[2]);
  }
  std::unordered_map<std::uint32_t, double> volumes;
  for (const auto& t : mesh.triangles) {
    const Vector3 a = mesh.vertices[t[0]].cast<double>();
    volumes[find(t[0])] += a.dot(mesh.vertices[t[1]].cast<double>().cross(mesh.vertices[t[2]].cast<double>()));
  }
  int positive = 0, negative = 0;
  for (const auto& [piece, volume] : volumes) (volume > 0 ? positive : negative) += 1;
  return negative == 0 ? 1 : positive == 0 ? -1 : 0;
}

class Rasteriser {
 public:
  static Rasteriser& instance() {
    static Rasteriser rasteriser;
    return rasteriser;
  }

  /// The scene from the origin of frame F; X_FC places the camera's frame in it.
  Picture draw(const RenderScene& scene, const Pose& X_FC, const Raster& raster) {
    const OffscreenGl::Current current(gl_);
    if (program_ == 0) start();
    size_targets(raster);
    glViewport(0, 0, raster.width, raster.height);
    glScissor(0, 0, raster.width, raster.height);  // for clearing
    const unsigned nothing[4] = {0, 0, 0, 0};
    glClearBufferuiv(GL_COLOR, 0, nothing);
    const float farthest = 0.f;
    glClearBufferfv(GL_DEPTH, 0, &farthest);
    glUseProgram(program_);
    // Window x = i + 1/2 where the direction is x0 + i dx; depth near/z, which is 1 at the near plane and 0 far away.
    Eigen::Matrix4d clip = Eigen::Matrix4d::Zero();
    clip(0, 0) = 2 / (raster.dx * raster.width);
    clip(0, 2) = 2 * (0.5 - raster.x0 / raster.dx) / raster.width - 1;
    clip(1, 1) = 2 / (raster.dy * raster.height);
    clip(1, 2) = 2 * (0.5 - raster.y0 / raster.dy) / raster.height - 1;
    clip(2, 3) = near_mm;
    clip(3, 2) = 1;
    for (std::size_t i = 0; i < scene.objects.size(); ++i) {
      const Buffers& buffers = buffers_of(*scene.objects[i].mesh);
      const Pose X_FO = X_FC * scene.objects[i].X_CO;
      cull(buffers, X_FO);
      const Eigen::Matrix4f clip_from_O = (clip * X_FO.matrix()).cast<float>();
      glUniformMatrix4fv(matrix_place_, 1, GL_FALSE, clip_from_O.data());
      glUniform1ui(object_place_, static_cast<unsigned>(i + 1));
      glBindVertexArray(buffers.array);
      glDrawElements(GL_TRIANGLES, buffers.indices, GL_UNSIGNED_INT, nullptr);
    }
    glBindVertexArray(0);
    Picture picture{raster, cv::Mat(raster.height, raster.width, CV_32SC2)};
    glReadPixels(0, 0, raster.width, raster.height, GL_RG_INTEGER, GL_UNSIGNED_INT, picture.seen.data);
    check_gl("drawing the scene");
    return picture;
  }

 private:
  struct Buffers {
    std::uint64_t key = 0;
    unsigned array = 0, vertices = 0, triangles = 0;
    int indices = 0;
    int outside = 0;  // +1, -1: closed, wound counter-clockwise (clockwise) seen from outside; 0: open
    Eigen::Vector3f low, high;
  };

  // From outside of a closed mesh its back faces are never seen: half of the work.
  static void cull(const Buffers& buffers, const Pose& X_FO) {
    const Eigen::Vector3f eye = X_FO.inverse().translation().cast<float>();
    const bool within = (eye.array() > buffers.low.array()).all() && (eye.array() < buffers.high.array()).all();
    if (buffers.outside == 0 || within) {
      glDisable(GL_CULL_FACE);
      return;
    }
    glEnable(GL_CULL_FACE);
    // The picture's y points down, and so does the window's here: what turns one way in space turns the other way on
    // it.
    glFrontFace(buffers.outside > 0 ? GL_CW : GL_CCW);
  }

  void start() {
    program_ = OffscreenGl::program(vertex_shader, fragment_shader);
    matrix_place_ = glGetUniformLocation(program_, "clip_from_O");
    object_place_ = glGetUniformLocation(program_, "object");
    glGenFramebuffers(1, &frame_);
    glGenRenderbuffers(2, targets_);
    glEnable(GL_DEPTH_TEST);
    glEnable(GL_SCISSOR_TEST);
    glDepthFunc(GL_GREATER);
    // libOSMesa does not export this one.
    const auto clip_control = reinterpret_cast<PFNGLCLIPCONTROLPROC>(OSMesaGetProcAddress("glClipControl"));
    if (!clip_control) throw Error("OpenGL: no glClipControl on " + gl_.driver());
    clip_control(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
  }

  // Both pictures of a frame share one target, which only grows.
  void size_targets(const Raster& raster) {
    glBindFramebuffer(GL_FRAMEBUFFER, frame_);
    if (raster.width <= width_ && raster.height <= height_) return;
    const int width = std::max(width_, raster.width), height = std::max(height_, raster.height);
    width_ = height_ = 0;
    glBindRenderbuffer(GL_RENDERBUFFER, targets_[0]);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_RG32UI, width, height);
    glBindRenderbuffer(GL_RENDERBUFFER, targets_[1]);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT32F, width, height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, targets_[0]);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, targets_[1]);
    if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
      throw Error("OpenGL: no picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels on " +
                  gl_.driver());
    }
    check_gl("a picture's memory");
    width_ = width;
    height_ = height;
  }

  const Buffers& buffers_of(const Mesh& mesh) {
    const std::uint64_t key = mesh.content_hash != 0 ? mesh.content_hash : hash_of(mesh);
    for (auto it = cache_.begin(); it != cache_.end(); ++it) {
      if (it->key == key) {
        cache_.splice(cache_.begin(), cache_, it);
        return cache_.front();
      }
    }
    Buffers buffers;
    buffers.key = key;
    buffers.indices = static_cast<int>(mesh.triangles.size() * 3);
    buffers.outside = outside_of(mesh);
    mesh.bounds(buffers.low, buffers.high);
    glGenVertexArrays(1, &buffers.array);
    glBindVertexArray(buffers.array);
    glGenBuffers(1, &buffers.vertices);
    glBindBuffer(GL_ARRAY_BUFFER, buffers.vertices);
    glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(mesh.vertices.size() * sizeof mesh.vertices[0]),
                 mesh.vertices.data(), GL_STATIC_DRAW);
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, nullptr);
    glGenBuffers(1, &buffers.triangles);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers.triangles);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, static_cast<GLsizeiptr>(mesh.triangles.size() * sizeof mesh.triangles[0]),
                 mesh.triangles.data(), GL_STATIC_DRAW);
    check_gl("the memory of " + mesh.name);
    cache_.push_front(buffers);
    if (cache_.size() > cached_meshes) {
      release(cache_.back());
      cache_.pop_back();
    }
    return cache_.front();
  }

  static void release(const Buffers& buffers) {
    glDeleteVertexArrays(1, &buffers.array);
    glDeleteBuffers(1, &buffers.vertices);
    glDeleteBuffers(1, &buffers.triangles);
  }

  OffscreenGl gl_;
  unsigned program_ = 0, frame_ = 0, targets_[2] = {0, 0};
  int matrix_place_ = -1, object_place_ = -1, width_ = 0, height_ = 0;
  std::list<Buffers> cache_;  // used last comes first
};

/// Calls body(row, memory) for every row, in parallel; rows of a band share one Memory.
template <typename Memory, typename Body>
void for_rows(int rows, const Body& body) {
  parallel_for((rows + band_rows - 1) / band_rows, [&](int band) {
    Memory memory;
    for (int row = band * band_rows; row < std::min(rows, (band + 1) * band_rows); ++row) body(row, memory);
  });
}
struct NoMemory {};

/// A triangle as a light sees it, in the camera's axes with the origin in the light.
class LitTriangle {
 public:
  LitTriangle() = default;
  LitTriangle(const SceneObject& object, std::uint32_t triangle, const Vector3& light) {
    const auto& t = object.mesh->triangles[triangle];
    Pose X = object.X_CO;
    X.translation() -= light;
    const Vector3 a = X * object.mesh->vertices[t[0]].cast<double>();
    const Vector3 b = X * object.mesh->vertices[t[1]].cast<double>();
    const Vector3 c = X * object.mesh->vertices[t[2]].cast<double>();
    sides_ = {b.cross(c), c.cross(a), a.cross(b)};
    volume_ = a.dot(sides_[0]);
    corners_ = {a, b, c};
  }
  /// Does the ray along d go through the triangle? Its border belongs to it, with a width of rounding.
  bool meets(const Vector3& d) const {
    const double a = d.dot(sides_[0]), b = d.dot(sides_[1]), c = d.dot(sides_[2]);
    const double slack = 1e-9 * (std::abs(a) + std::abs(b) + std::abs(c));
    return (a >= -slack && b >= -slack && c >= -slack) || (a <= slack && b <= slack && c <= slack);
  }
  /// Where the ray t d meets the triangle's plane, kept to the triangle's extent along the ray and a little more.
  double reach(const Vector3& d) const {
    const double across = d.dot(sides_[0] + sides_[1] + sides_[2]);
    const double along[3] = {d.dot(corners_[0]), d.dot(corners_[1]), d.dot(corners_[2])};
    const double scale = 1 / d.squaredNorm();
    const double low = std::min({along[0], along[1], along[2]}) * scale;
    const double high = std::max({along[0], along[1], along[2]}) * scale;
    const double slack = high - low + beyond_triangle_mm * std::sqrt(scale);
    return across != 0 ? std::clamp(volume_ / across, low - slack, high + slack) : low;
  }

 private:
  std::array<Vector3, 3> sides_, corners_;
  double volume_ = 0;
};

class Rasterising final : public Visibility {
 public:
  Rasterising(const RenderScene& scene, const Camera& camera) : scene_(scene), camera_(camera) {}

  FirstHits first_hits(const cv::Mat& rays) override {
    FirstHits hits{cv::Mat(rays.size(), CV_16U), cv::Mat(rays.size(), CV_32S)};
    const Raster raster = camera_.distorted() ? raster_around(rays) : raster_of(camera_);
    const Picture picture = Rasteriser::instance().draw(scene_, Pose::Identity(), raster);
    const bool distorted = camera_.distorted();
    for_rows<PlacedCache>(rays.rows, [&](int row, PlacedCache& placed) {
      const auto* ray = rays.ptr<cv::Vec2f>(row);
      auto* object = hits.object.ptr<std::uint16_t>(row);
      auto* triangle = hits.triangle.ptr<std::int32_t>(row);
      for (int col = 0; col < rays.cols; ++col) {
        const cv::Vec2i seen = distorted ? met_along(picture, ray[col], placed) : picture.at(row, col);
        object[col] = static_cast<std::uint16_t>(seen[0]);
        triangle[col] = seen[0] != 0 ? seen[1] : -1;
      }
    });
    return hits;
  }

  cv::Mat gaps(const Vector3& light_mm, const cv::Mat& rays, const cv::Mat& depth_mm, const FirstHits& hits) override {
    cv::Mat gap = cv::Mat::zeros(rays.size(), CV_32F);
    const Eigen::Matrix3d towards = facing_points(light_mm, rays, depth_mm);
    const int points = cv::countNonZero(depth_mm);
    int done = 0;
    for (const Eigen::Matrix3d& turn : cube_faces()) {
      if (done >= points) break;
      done += face_gaps(light_mm, turn * towards, rays, depth_mm, hits, gap);
    }
    return gap;
  }

 private:
  /// Triangles asked for lately; neighbouring pixels ask for the same ones.
  struct PlacedCache {
    struct Entry {
      cv::Vec2i seen{0, -1};
      LitTriangle triangle;
    };
    std::array<Entry, 64> entries;
  };
  const LitTriangle& placed_in(PlacedCache& cache, const cv::Vec2i& seen, const Vector3& light) const {
    const auto place = static_cast<std::size_t>(seen[0] * 7 + seen[1]) % cache.entries.size();
    PlacedCache::Entry& entry = cache.entries[place];
    if (seen != entry.seen) {
      entry.seen = seen;
      entry.triangle = LitTriangle(scene_.objects[static_cast<std::size_t>(seen[0] - 1)],
                                   static_cast<std::uint32_t>(seen[1]), light);
    }
    return entry.triangle;
  }

  /// The four raster pixels around a direction; the nearest comes first.
  static std::array<cv::Vec2i, 4> around(const Picture& picture, double x, double y) {
    const Raster& r = picture.raster;
    const double i = (x - r.x0) / r.dx, j = (y - r.y0) / r.dy;
    const int left = std::clamp(static_cast<int>(i), 0, r.width - 2),
              top = std::clamp(static_cast<int>(j), 0, r.height - 2);
    const int near_x = i - left > 0.5, near_y = j - top > 0.5;
    return {picture.at(top + near_y, left + near_x), picture.at(top + near_y, left + 1 - near_x),
            picture.at(top + 1 - near_y, left + near_x), picture.at(top + 1 - near_y, left + 1 - near_x)};
  }

  /// Which of the triangles seen around the exact ray of a distorted camera it goes through first; where it goes
  /// through none of them (they are smaller than a raster pixel), the nearest pixel's.
  cv::Vec2i met_along(const Picture& picture, const cv::Vec2f& ray, PlacedCache& placed) const {
    const std::array<cv::Vec2i, 4> seen = around(picture, ray[0], ray[1]);
    const Vector3 d(ray[0], ray[1], 1);
    cv::Vec2i best = seen[0];
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 4; ++k) {
      if (seen[k][0] == 0 || (k > 0 && seen[k] == seen[k - 1])) continue;
      const LitTriangle& triangle = placed_in(placed, seen[k], Vector3::Zero());
      if (!triangle.meets(d)) continue;
      const double z = triangle.reach(d);
      if (z < nearest) {
        nearest = z;
        best = seen[k];
      }
    }
    return best;
  }

  static Raster raster_of(const Camera& camera) {
    return {camera.width, camera.height, -camera.cx / camera.fx, -camera.cy / camera.fy, 1 / camera.fx, 1 / camera.fy};
  }

  // A finer pinhole picture around all rays of a distorted camera.
  Raster raster_around(const cv::Mat& rays) const {
    cv::Mat planes[2];
    cv::split(rays, planes);
    double x_min, x_max, y_min, y_max;
    cv::minMaxLoc(planes[0], &x_min, &x_max);
    cv::minMaxLoc(planes[1], &y_min, &y_max);
    return fitted(x_min, x_max, y_min, y_max, lens_oversampling * camera_.fx, lens_oversampling * camera_.fy);
  }

  static Raster fitted(double x_min, double x_max, double y_min, double y_max, double per_x, double per_y) {
    Raster raster;
    raster.width = std::clamp(static_cast<int>(std::ceil((x_max - x_min) * per_x)) + 2, 2, largest_raster);
    raster.height = std::clamp(static_cast<int>(std::ceil((y_max - y_min) * per_y)) + 2, 2, largest_raster);
    raster.dx = std::max((x_max - x_min) / (raster.width - 2), 1e-9);
    raster.dy = std::max((y_max - y_min) / (raster.height - 2), 1e-9);
    raster.x0 = x_min - raster.dx / 2;
    raster.y0 = y_min - raster.dy / 2;
    return raster;
  }

  // Axes whose z points from the light to the middle of what is seen. The camera's own where that is near enough.
  static Eigen::Matrix3d facing_points(const Vector3& light, const cv::Mat& rays, const cv::Mat& depth_mm) {
    Vector3 sum = Vector3::Zero();
    for (int row = 0; row < depth_mm.rows; row += 8) {
      for (int col = 0; col < depth_mm.cols; col += 8) {
        const double z = depth_mm.at<float>(row, col);
        const auto& ray = rays.at<cv::Vec2f>(row, col);
        if (z > 0) sum += (Vector3(ray[0] * z, ray[1] * z, z) - light).normalized();
      }
    }
    const Vector3 z = sum.normalized();
    if (sum.norm() == 0 || z.z() > 0.9) return Eigen::Matrix3d::Identity();
    // Quaterniond::FromTwoVectors brings a singular value decomposition that takes the compiler 17 s.
    const Vector3 about = z.z() > -1 + 1e-9 ? Vector3(z.y(), -z.x(), 0).normalized() : Vector3(1, 0, 0);
    return Eigen::AngleAxisd(std::acos(z.z()), about).toRotationMatrix();
  }

  // The six faces of a cube about the light: a light in the middle of things sees them all; usually one is enough.
  static const std::array<Eigen::Matrix3d, 6>& cube_faces() {
    static const std::array<Eigen::Matrix3d, 6> faces = [] {
      std::array<Eigen::Matrix3d, 6> out;
      const double quarter = EIGEN_PI / 2;
      const Vector3 x(1, 0, 0), y(0, 1, 0);
      out[0] = Eigen::Matrix3d::Identity();
      out[1] = Eigen::AngleAxisd(quarter, y).toRotationMatrix();
      out[2] = Eigen::AngleAxisd(-quarter, y).toRotationMatrix();
      out[3] = Eigen::AngleAxisd(quarter, x).toRotationMatrix();
      out[4] = Eigen::AngleAxisd(-quarter, x).toRotationMatrix();
      out[5] = Eigen::AngleAxisd(2 * quarter, x).toRotationMatrix();
      return out;
    }();
    return faces;
  }

  template <typename Vector>
  static bool on_face(const Vector& p) {
    return p.z() > 0 && std::abs(p.x()) <= p.z() && std::abs(p.y()) <= p.z();
  }

  // The gaps of the points that lie on one face of the cube, and how many there are. R_LC: from the camera's axes to
  // the face's.
  int face_gaps(const Vector3& light, const Eigen::Matrix3d& R_LC, const cv::Mat& rays, const cv::Mat& depth_mm,
                const FirstHits& hits, cv::Mat& gap) const {
    const Eigen::Matrix3f R = R_LC.cast<float>();
    const Eigen::Vector3f l = light.cast<float>();
    // Where in the map: single precision is a hundredth of a texel.
    const auto direction = [&](const cv::Vec2f& ray, float z, float& x, float& y) {
      const Eigen::Vector3f p = R * Eigen::Vector3f(ray[0] * z - l.x(), ray[1] * z - l.y(), z - l.z());
      const float inverse = 1.f / p.z();
      x = p.x() * inverse;
      y = p.y() * inverse;
      return on_face(p);
    };
    struct Bounds {
      float x_min = 2, x_max = -2, y_min = 2, y_max = -2;
      int points = 0;
    };
    std::vector<Bounds> of_rows(static_cast<std::size_t>(rays.rows));
    for_rows<NoMemory>(rays.rows, [&](int row, NoMemory&) {
      Bounds b;
      const auto* depth = depth_mm.ptr<float>(row);
      const auto* ray = rays.ptr<cv::Vec2f>(row);
      for (int col = 0; col < rays.cols; ++col) {
        float x, y;
        if (depth[col] <= 0.f || !direction(ray[col], depth[col], x, y)) continue;
        b.x_min = std::min(b.x_min, x);
        b.x_max = std::max(b.x_max, x);
        b.y_min = std::min(b.y_min, y);
        b.y_max = std::max(b.y_max, y);
        ++b.points;
      }
      of_rows[static_cast<std::size_t>(row)] = b;
    });
    Bounds all;
    for (const Bounds& b : of_rows) {
      all = {std::min(all.x_min, b.x_min), std::max(all.x_max, b.x_max), std::min(all.y_min, b.y_min),
             std::max(all.y_max, b.y_max), all.points + b.points};
    }
    if (all.points == 0) return 0;
    const Raster raster = fitted(all.x_min, all.x_max, all.y_min, all.y_max,
                                 map_oversampling * camera_.width / std::max(all.x_max - all.x_min, 1e-6f),
                                 map_oversampling * camera_.height / std::max(all.y_max - all.y_min, 1e-6f));
    Pose X_LC = Pose::Identity();
    X_LC.linear() = R_LC;
    X_LC.translation() = -(R_LC * light);
    const Picture map = Rasteriser::instance().draw(scene_, X_LC, raster);
    for_rows<PlacedCache>(rays.rows, [&](int row, PlacedCache& placed) {
      const auto* depth = depth_mm.ptr<float>(row);
      const auto* ray = rays.ptr<cv::Vec2f>(row);
      const auto* object = hits.object.ptr<std::uint16_t>(row);
      const auto* triangle = hits.triangle.ptr<std::int32_t>(row);
      auto* out = gap.ptr<float>(row);
      for (int col = 0; col < rays.cols; ++col) {
        float x, y;
        if (depth[col] <= 0.f || !direction(ray[col], depth[col], x, y)) continue;
        const cv::Vec2i own(object[col], triangle[col]);
        const std::array<cv::Vec2i, 4> seen = around(map, x, y);
        if (own[0] != 0 && seen[0] == own && seen[1] == own && seen[2] == own && seen[3] == own) continue;
        const double z = depth[col];
        out[col] = point_gap(seen, Vector3(ray[col][0] * z, ray[col][1] * z, z) - light, light, placed);
      }
    });
    return all.points;
  }

  /// p: the point in the camera's axes, from the light.
  float point_gap(const std::array<cv::Vec2i, 4>& seen, const Vector3& p, const Vector3& light,
                  PlacedCache& placed) const {
    const double length = p.norm();
    double behind_met = -1, behind_least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 4; ++k) {
      if (k > 0 && seen[k] == seen[k - 1]) continue;
      double behind = 0;
      bool met = false;
      if (seen[k][0] != 0) {
        const LitTriangle& triangle = placed_in(placed, seen[k], light);
        met = triangle.meets(p);
        behind = std::max(0.0, length * (1 - triangle.reach(p)));
      }
      if (met) behind_met = std::max(behind_met, behind);
      behind_least = std::min(behind_least, behind);
    }
    // No triangle around is met where they are smaller than a texel: the nearest to explaining the point counts.
    const double behind = behind_met >= 0 ? behind_met : behind_least;
    return behind > lit_within_mm ? static_cast<float>(behind) : 0.f;
  }

  const RenderScene& scene_;
  const Camera& camera_;
};

class OsmesaRenderer final : public Renderer {
 public:
  std::string name() const override { return "osmesa"; }
  std::shared_ptr<const Channels> render(const RenderScene& scene, const RenderRequest& request) const override {
    Rasterising rasterising(scene, request.camera);
    return render_channels(scene, request, rasterising);
  }
};
}  // namespace

std::unique_ptr<Renderer> make_osmesa_renderer() { return std::make_unique<OsmesaRenderer>(); }

}  // namespace binrig
