#include "sim/shading.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/ray_table.h"

namespace binrig {

namespace {
constexpr int band_rows = 8;
constexpr double nearest_mm = 1e-3;
constexpr double beyond_triangle_mm = 1;

void for_bands(int rows, const std::function<void(int)>& row_body) {
  parallel_for((rows + band_rows - 1) / band_rows, [&](int band) {
    const int end = std::min(rows, (band + 1) * band_rows);
    for (int row = band * band_rows; row < end; ++row) row_body(row);
  });
}

// Is p inside the closed surface? Crossings along a ray are odd then; three directions vote, since a ray may graze an
// edge.
bool inside(const Mesh& mesh, const Vector3& p) {
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  if ((p.cast<float>().array() < low.array()).any() || (p.cast<float>().array() > high.array()).any()) return false;
  const std::array<Vector3, 3> directions{Vector3(0.61, 0.35, 0.71).normalized(),
                                          Vector3(-0.43, 0.83, 0.36).normalized(),
                                          Vector3(0.27, -0.52, -0.81).normalized()};
  int votes = 0;
  for (const Vector3& d : directions) {
    int crossings = 0;
    for (const auto& t : mesh.triangles) {  // Moeller and Trumbore (1997)
      const Vector3 a = mesh.vertices[t[0]].cast<double>();
      const Vector3 ab = mesh.vertices[t[1]].cast<double>() - a, ac = mesh.vertices[t[2]].cast<double>() - a;
      const Vector3 h = d.cross(ac);
      const double det = ab.dot(h);
      if (det == 0) continue;
      const Vector3 s = p - a;
      const double u = s.dot(h) / det;
      const Vector3 q = s.cross(ab);
      const double v = d.dot(q) / det;
      if (u >= 0 && v >= 0 && u + v <= 1 && ac.dot(q) / det > 0) ++crossings;
    }
    votes += crossings % 2;
  }
  return votes == 3;
}

void check_request(const RenderScene& scene, const RenderRequest& request) {
  request.camera.check("camera to render");
  Violations violations;
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    const SceneObject& object = scene.objects[i];
    const std::string where = "object " + std::to_string(i + 1) + " (" + object.mesh->name + ")";
    if (!object.X_CO.matrix().allFinite()) {
      violations.add(where, "X_CO", "is not finite");
    } else if (request.check_inside && inside(*object.mesh, object.X_CO.inverse().translation())) {
      violations.add(where, "X_CO", "the camera is inside it");
    }
  }
  if (scene.objects.size() > 65000) violations.add("scene", "objects", "more than 65000 objects");
  violations.throw_if_any("This scene cannot be rendered.");
}

struct Job {
  const RenderScene& scene;
  const RenderRequest& request;
  const cv::Mat rays;
  const FirstHits& hits;
  Channels& out;
  Vector3 light;  // the projector, or the camera's centre
};

const Surface& surface_at(const Job& job, int row, int col) {
  const std::size_t object = job.hits.object.empty() ? 0 : job.hits.object.at<std::uint16_t>(row, col);
  const bool plane = job.out.instance.at<std::uint16_t>(row, col) > job.scene.objects.size();
  if (plane || object == 0) return job.scene.plane->surface;
  return job.scene.objects[object - 1].mesh->surface_of(
      static_cast<std::size_t>(job.hits.triangle.at<std::int32_t>(row, col)));
}

// Depth, normal and instance: the exact ray against the plane of its triangle and against the backdrop.
void resolve_row(const Job& job, int row) {
  const int cols = job.request.camera.width;
  const auto* rays = job.rays.ptr<cv::Vec2f>(row);
  const bool meshes = !job.hits.object.empty();
  const auto* hit_object = meshes ? job.hits.object.ptr<std::uint16_t>(row) : nullptr;
  const auto* hit_triangle = meshes ? job.hits.triangle.ptr<std::int32_t>(row) : nullptr;
  auto* depth = job.out.depth_mm.ptr<float>(row);
  auto* normal = job.out.normal.ptr<cv::Vec3f>(row);
  auto* instance = job.out.instance.ptr<std::uint16_t>(row);
  const auto plane_id = static_cast<std::uint16_t>(job.scene.objects.size() + 1);

  std::uint16_t last_object = 0;
  std::int32_t last_triangle = -1;
  PlacedTriangle placed;
  for (int col = 0; col < cols; ++col) {
    const double x = rays[col][0], y = rays[col][1];
    double z = 0;
    const Vector3* n = nullptr;
    if (meshes && hit_object[col] > 0) {
      if (hit_object[col] != last_object || hit_triangle[col] != last_triangle) {
        last_object = hit_object[col];
        last_triangle = hit_triangle[col];
        placed = placed_triangle(job.scene.objects[last_object - 1u], static_cast<std::uint32_t>(last_triangle));
      }
      const double across = placed.normal.x() * x + placed.normal.y() * y + placed.normal.z();
      z = across != 0 ? placed.offset_mm / across : placed.z_min_mm;
      // Along a grazing ray the plane says little; the triangle's extent bounds what can be.
      z = std::max(std::clamp(z, placed.z_min_mm, placed.z_max_mm), nearest_mm);
      n = &placed.normal;
      instance[col] = last_object;
    }
    if (job.scene.plane) {
      const ScenePlane& plane = *job.scene.plane;
      const double across = plane.normal.x() * x + plane.normal.y() * y + plane.normal.z();
      const double z_plane = across != 0 ? plane.offset_mm / across : 0;
      if (z_plane > nearest_mm && (!n || z_plane < z)) {
        z = z_plane;
        n = &plane.normal;
        instance[col] = plane_id;
      }
    }
    if (!n) {
      depth[col] = 0.f;
      normal[col] = {0.f, 0.f, 0.f};
      instance[col] = 0;
      continue;
    }
    depth[col] = static_cast<float>(z);
    const double towards = n->x() * x + n->y() * y + n->z() > 0 ? -1 : 1;
    normal[col] = {static_cast<float>(towards * n->x()), static_cast<float>(towards * n->y()),
                   static_cast<float>(towards * n->z())};
  }
}

// cos_incidence, diffuse and specular (EFFECTS.md, paragraph IR), shadow not applied.
void light_row(const Job& job, int row, bool wants_cosine, bool wants_diffuse, bool wants_specular) {
  const auto* rays = job.rays.ptr<cv::Vec2f>(row);
  const auto* depth = job.out.depth_mm.ptr<float>(row);
  const auto* normal = job.out.normal.ptr<cv::Vec3f>(row);
  auto* cosine = wants_cosine ? job.out.cos_incidence.ptr<float>(row) : nullptr;
  auto* diffuse = wants_diffuse ? job.out.diffuse.ptr<float>(row) : nullptr;
  auto* specular = wants_specular ? job.out.specular.ptr<float>(row) : nullptr;
  const auto light_x = static_cast<float>(job.light.x()), light_y = static_cast<float>(job.light.y()),
             light_z = static_cast<float>(job.light.z());
  const auto z0 = static_cast<float>(job.request.reference_distance_mm);
  const bool needs_surface = wants_diffuse || wants_specular;
  const Surface* last_surface = nullptr;
  float least_mirrored = 0;  // below it the highlight of that surface is less than a millionth
  for (int col = 0; col < job.request.camera.width; ++col) {
    const float z = depth[col];
    if (z <= 0.f) {
      if (cosine) cosine[col] = 0.f;
      if (diffuse) diffuse[col] = 0.f;
      if (specular) specular[col] = 0.f;
      continue;
    }
    const cv::Vec3f& n = normal[col];
    const float x = rays[col][0], y = rays[col][1];
    const float ray_length = std::sqrt(x * x + y * y + 1.f);
    const float n_view = std::clamp(-(n[0] * x + n[1] * y + n[2]) / ray_length, 0.f, 1.f);  // towards the camera
    if (cosine) cosine[col] = n_view;
    if (!needs_surface) continue;
    const Surface& surface = surface_at(job, row, col);
    const float lx = light_x - x * z, ly = light_y - y * z, lz = light_z - z;
    const float r2 = std::max(lx * lx + ly * ly + lz * lz, 1e-6f);
    const float r = std::sqrt(r2);
    const float n_light = (n[0] * lx + n[1] * ly + n[2] * lz) / r;
    if (diffuse) diffuse[col] = n_light > 0.f ? surface.albedo * n_light * z0 * z0 / r2 : 0.f;
    if (specular) {
      float value = 0.f;
      if (surface.specular > 0.f && n_light > 0.f) {
        if (&surface != last_surface) {
          last_surface = &surface;
          least_mirrored = surface.shininess > 0.f ? std::exp(-14.f / surface.shininess) : 0.f;
        }
        // R . V with R = 2 (n . L) n - L and V = -ray
        const float light_view = -(lx * x + ly * y + lz) / (r * ray_length);
        const float mirrored_view = std::min(2.f * n_light * n_view - light_view, 1.f);
        if (mirrored_view > least_mirrored) value = surface.specular * std::pow(mirrored_view, surface.shininess);
      }
      specular[col] = value;
    }
  }
}

void infrared_row(const Job& job, int row) {
  const auto* diffuse = job.out.diffuse.ptr<float>(row);
  const auto* specular = job.out.specular.ptr<float>(row);
  const auto* gap = job.out.projector_gap_mm.empty() ? nullptr : job.out.projector_gap_mm.ptr<float>(row);
  auto* ir = job.out.ir.ptr<float>(row);
  for (int col = 0; col < job.out.ir.cols; ++col) {
    const bool lit = !gap || gap[col] <= shadow_epsilon_mm;
    ir[col] = lit ? diffuse[col] + 0.5f * specular[col] : 0.f;
  }
}

// The backdrop as an occluder, and as a surface for objects to shade: joins it to the gaps of the meshes.
void add_plane_to_gaps(const Job& job, const Vector3& light, cv::Mat& gap) {
  const ScenePlane& plane = *job.scene.plane;
  const double light_side = plane.normal.dot(light) - plane.offset_mm;
  for_bands(gap.rows, [&](int row) {
    const auto* rays = job.rays.ptr<cv::Vec2f>(row);
    const auto* depth = job.out.depth_mm.ptr<float>(row);
    auto* g = gap.ptr<float>(row);
    for (int col = 0; col < gap.cols; ++col) {
      if (depth[col] <= 0.f) continue;
      const Vector3 p(double{rays[col][0]} * depth[col], double{rays[col][1]} * depth[col], depth[col]);
      const double side = plane.normal.dot(p) - plane.offset_mm;
      if (side * light_side >= 0) continue;
      const double share_behind = side / (side - light_side);
      const double behind = share_behind * (p - light).norm();
      if (behind > lit_within_mm) g[col] = std::max(g[col], static_cast<float>(behind));
    }
  });
}

cv::Mat gaps_from(const Job& job, const Vector3& light, Visibility& visibility) {
  cv::Mat gap = visibility.gaps(light, job.rays, job.out.depth_mm, job.hits);
  if (job.scene.plane) add_plane_to_gaps(job, light, gap);
  return gap;
}

// Ambient and point lights with shadows; a white Phong highlight.
void add_rgb(const Job& job, Visibility& visibility) {
  const int rows = job.request.camera.height, cols = job.request.camera.width;
  cv::Mat diffuse(rows, cols, CV_32F, cv::Scalar(job.scene.ambient)), shine = cv::Mat::zeros(rows, cols, CV_32F);
  for (const RgbLight& light : job.scene.lights) {
    const cv::Mat gap = gaps_from(job, light.position_mm, visibility);
    for_bands(rows, [&](int row) {
      for (int col = 0; col < cols; ++col) {
        const float z = job.out.depth_mm.at<float>(row, col);
        if (z <= 0.f || gap.at<float>(row, col) > shadow_epsilon_mm) continue;
        const auto& ray = job.rays.at<cv::Vec2f>(row, col);
        const cv::Vec3f n = job.out.normal.at<cv::Vec3f>(row, col);
        const cv::Vec3f view = cv::normalize(cv::Vec3f(-ray[0], -ray[1], -1.f));
        const cv::Vec3f to_light = cv::normalize(cv::Vec3f(static_cast<float>(light.position_mm.x()) - ray[0] * z,
                                                           static_cast<float>(light.position_mm.y()) - ray[1] * z,
                                                           static_cast<float>(light.position_mm.z()) - z));
        const float n_light = n.dot(to_light);
        if (n_light <= 0.f) continue;
        diffuse.at<float>(row, col) += light.intensity * n_light;
        const Surface& surface = surface_at(job, row, col);
        const float mirrored_view = 2.f * n_light * n.dot(view) - to_light.dot(view);
        if (surface.specular > 0.f && mirrored_view > 0.f) {
          shine.at<float>(row, col) += light.intensity * surface.specular * std::pow(mirrored_view, surface.shininess);
        }
      }
    });
  }
  job.out.rgb = cv::Mat::zeros(rows, cols, CV_8UC3);
  for_bands(rows, [&](int row) {
    for (int col = 0; col < cols; ++col) {
      if (job.out.depth_mm.at<float>(row, col) <= 0.f) continue;
      const Surface& surface = surface_at(job, row, col);
      for (int c = 0; c < 3; ++c) {
        const float value =
            surface.rgb[static_cast<std::size_t>(c)] * diffuse.at<float>(row, col) + shine.at<float>(row, col);
        job.out.rgb.at<cv::Vec3b>(row, col)[c] = cv::saturate_cast<uchar>(255.f * value);
      }
    }
  });
}
}  // namespace

PlacedTriangle placed_triangle(const SceneObject& object, std::uint32_t triangle) {
  const auto& t = object.mesh->triangles[triangle];
  const Vector3 a = object.X_CO * object.mesh->vertices[t[0]].cast<double>();
  const Vector3 b = object.X_CO * object.mesh->vertices[t[1]].cast<double>();
  const Vector3 c = object.X_CO * object.mesh->vertices[t[2]].cast<double>();
  PlacedTriangle placed;
  const Vector3 n = (b - a).cross(c - a);
  const double length = n.norm();
  // A triangle without area has no plane; it faces the camera then, at the depth of its corners.
  placed.normal = length > 0 ? Vector3(n / length) : Vector3(0, 0, -1);
  placed.offset_mm = placed.normal.dot(a);
  placed.z_min_mm = std::min({a.z(), b.z(), c.z()});
  placed.z_max_mm = std::max({a.z(), b.z(), c.z()});
  // A rasteriser may name the neighbour of the triangle that the exact ray meets: its plane holds a little beyond it.
  const double slack = placed.z_max_mm - placed.z_min_mm + beyond_triangle_mm;
  placed.z_min_mm -= slack;
  placed.z_max_mm += slack;
  return placed;
}

std::shared_ptr<const Channels> render_channels(const RenderScene& scene, const RenderRequest& request,
                                                Visibility& visibility) {
  check_request(scene, request);
  const ChannelSet wanted = request.wanted;
  const auto want = [&](Channel c) { return contains(wanted, c); };
  const bool ir = want(Channel::ir), diffuse = ir || want(Channel::diffuse), specular = ir || want(Channel::specular);
  const bool cosine = want(Channel::cos_incidence);
  const bool edges = want(Channel::edge_distance) || want(Channel::crease_distance);

  auto channels = std::make_shared<Channels>();
  Channels& out = *channels;
  out.camera = request.camera;
  const cv::Size size(request.camera.width, request.camera.height);
  out.depth_mm.create(size, CV_32F);
  out.normal.create(size, CV_32FC3);
  out.instance.create(size, CV_16U);
  if (cosine) out.cos_incidence.create(size, CV_32F);
  if (diffuse) out.diffuse.create(size, CV_32F);
  if (specular) out.specular.create(size, CV_32F);

  const cv::Mat rays = ray_table(request.camera);
  const FirstHits hits = scene.objects.empty() ? FirstHits{} : visibility.first_hits(rays);
  const Job job{scene, request, rays, hits, out, request.projector_xyz_mm.value_or(Vector3::Zero())};
  for_bands(size.height, [&](int row) {
    resolve_row(job, row);
    if (cosine || diffuse || specular) light_row(job, row, cosine, diffuse, specular);
  });
  if (request.projector_xyz_mm && (ir || want(Channel::projector_gap))) {
    out.projector_gap_mm = gaps_from(job, *request.projector_xyz_mm, visibility);
  }
  if (ir) {
    out.ir.create(size, CV_32F);
    for_bands(size.height, [&](int row) { infrared_row(job, row); });
  }
  if (want(Channel::rgb)) add_rgb(job, visibility);
  if (edges) add_edge_channels(out, wanted);

  // Made on the way only.
  if (!want(Channel::normal)) out.normal.release();
  if (!want(Channel::instance)) out.instance.release();
  if (!want(Channel::diffuse)) out.diffuse.release();
  if (!want(Channel::specular)) out.specular.release();
  if (!want(Channel::projector_gap)) out.projector_gap_mm.release();
  return channels;
}

}  // namespace binrig
