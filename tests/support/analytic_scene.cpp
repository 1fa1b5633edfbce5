#include "tests/support/analytic_scene.h"

#include <cmath>

#include <opencv2/core.hpp>

namespace binrig::test {
namespace {

struct Hit {
  double t = 0;  ///< 0 = none
  Vector3 normal = Vector3::Zero();
  int object = 0;
  const AnalyticSurface* surface = nullptr;
};

void keep_nearer(Hit& best, double t, const Vector3& normal, int object, const AnalyticSurface& surface) {
  if (t > 1e-9 && (best.t == 0 || t < best.t)) best = {t, normal, object, &surface};
}

/// First surface on origin + t direction.
Hit first_hit(const AnalyticScene& scene, const Vector3& origin, const Vector3& direction) {
  Hit best;
  if (scene.has_plane) {
    const double along = scene.plane_normal.dot(direction);
    if (std::abs(along) > 1e-12) {
      keep_nearer(best, (scene.plane_offset_mm - scene.plane_normal.dot(origin)) / along, scene.plane_normal, 1,
                  scene.plane_surface);
    }
  }
  if (scene.box) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const Vector3& corner : {scene.box->first, scene.box->second}) {
        if (direction[axis] == 0) continue;
        const double t = (corner[axis] - origin[axis]) / direction[axis];
        const Vector3 p = origin + t * direction;
        bool inside = true;
        for (int other = 0; other < 3; ++other) {
          inside &= other == axis || (p[other] >= scene.box->first[other] && p[other] <= scene.box->second[other]);
        }
        if (inside) keep_nearer(best, t, Vector3::Unit(axis), 2, scene.box_surface);
      }
    }
  }
  if (scene.sphere) {
    const Vector3 to = origin - scene.sphere->centre;
    const double a = direction.squaredNorm(), b = to.dot(direction),
                 c = to.squaredNorm() - scene.sphere->radius * scene.sphere->radius;
    const double discriminant = b * b - a * c;
    if (discriminant > 0) {
      const double t = (-b - std::sqrt(discriminant)) / a;
      keep_nearer(best, t, (to + t * direction).normalized(), 3, scene.sphere_surface);
    }
  }
  return best;
}

AnalyticScene moved(AnalyticScene scene, double time_s) {
  const Vector3 by = scene.velocity_mm_per_s * time_s;
  scene.plane_offset_mm += scene.plane_normal.dot(by);
  if (scene.box) scene.box = {scene.box->first + by, scene.box->second + by};
  if (scene.sphere) scene.sphere->centre += by;
  return scene;
}

}  // namespace

AnalyticScene mixed_scene() {
  AnalyticScene scene;
  scene.plane_normal = Vector3(-0.05, 0.08, -1).normalized();
  scene.plane_offset_mm = scene.plane_normal.z() * 800;
  scene.plane_surface = {0.5, 0.2, 5};
  scene.box = {Vector3(-180, -90, 700), Vector3(-60, 60, 900)};
  scene.box_surface = {0.04, 0.1, 20};
  scene.sphere = AnalyticScene::Sphere{Vector3(110, 20, 720), 70};
  scene.sphere_surface = {0.4, 0.95, 12};
  return scene;
}

AnalyticScene plane_scene(double z_mm, double tilt_rad, double albedo) {
  AnalyticScene scene;
  scene.plane_normal = Vector3(std::sin(tilt_rad), 0, -std::cos(tilt_rad));
  scene.plane_offset_mm = scene.plane_normal.z() * z_mm;
  scene.plane_surface.albedo = albedo;
  return scene;
}

Camera small_camera() {
  Camera camera;
  camera.width = 160;
  camera.height = 120;
  camera.fx = camera.fy = 200;
  camera.cx = 79.5;
  camera.cy = 59.5;
  return camera;
}

std::shared_ptr<const Channels> analytic_channels(const AnalyticScene& scene_at_start, const Camera& camera,
                                                  const std::optional<Vector3>& projector_xyz_mm, double z0,
                                                  double time_s) {
  const AnalyticScene scene = moved(scene_at_start, time_s);
  auto channels = std::make_shared<Channels>();
  channels->camera = camera;
  const cv::Size size(camera.width, camera.height);
  for (cv::Mat* image : {&channels->depth_mm, &channels->cos_incidence, &channels->diffuse, &channels->specular,
                         &channels->ir, &channels->projector_gap_mm}) {
    *image = cv::Mat::zeros(size, CV_32F);
  }
  channels->normal = cv::Mat::zeros(size, CV_32FC3);
  channels->instance = cv::Mat::zeros(size, CV_16U);
  channels->rgb = cv::Mat(size, CV_8UC3, cv::Scalar(90, 90, 90));
  const Vector3 projector = projector_xyz_mm.value_or(Vector3::Zero());
  for (int row = 0; row < size.height; ++row) {
    for (int col = 0; col < size.width; ++col) {
      const Vector3 ray = camera.ray(col, row);
      const Hit hit = first_hit(scene, Vector3::Zero(), ray);
      if (hit.t == 0) continue;
      const Vector3 p = hit.t * ray;
      const Vector3 view = -ray.normalized();
      const Vector3 normal = hit.normal.dot(view) < 0 ? Vector3(-hit.normal) : hit.normal;
      const Vector3 from_light = p - projector;
      const Vector3 incoming = from_light.normalized();
      const double cos_light = std::max(0.0, -normal.dot(incoming));
      const double diffuse = hit.surface->albedo * cos_light * std::pow(z0 / from_light.norm(), 2);
      const Vector3 mirrored = incoming - 2 * normal.dot(incoming) * normal;
      const double specular =
          hit.surface->specular * std::pow(std::max(0.0, mirrored.dot(view)), hit.surface->shininess);
      const double gap = from_light.norm() - first_hit(scene, projector, incoming).t;
      channels->depth_mm.at<float>(row, col) = static_cast<float>(p.z());
      channels->normal.at<cv::Vec3f>(row, col) = cv::Vec3f(normal.x(), normal.y(), normal.z());
      channels->cos_incidence.at<float>(row, col) = static_cast<float>(normal.dot(view));
      channels->instance.at<std::uint16_t>(row, col) = static_cast<std::uint16_t>(hit.object);
      channels->diffuse.at<float>(row, col) = static_cast<float>(diffuse);
      channels->specular.at<float>(row, col) = static_cast<float>(specular);
      channels->projector_gap_mm.at<float>(row, col) = static_cast<float>(gap < 1e-6 ? 0 : gap);
      const bool lit = gap <= shadow_epsilon_mm && cos_light > 0;
      channels->ir.at<float>(row, col) = static_cast<float>(lit ? diffuse + 0.5 * specular : 0);
    }
  }
  if (!projector_xyz_mm) channels->projector_gap_mm = cv::Mat();
  add_edge_channels(*channels, Channel::edge_distance | Channel::crease_distance);
  return channels;
}

CaptureContext analytic_context(const AnalyticScene& scene, const Camera& camera) {
  CaptureContext context;
  context.camera = camera;
  context.projector_xyz_mm = Vector3(75, 0, 0);
  context.reference_distance_mm = 800;
  context.depth_scale_mm = 0.02;
  context.frames = 8;
  context.power_on = true;
  context.motion = scene.velocity_mm_per_s.norm() > 0;
  context.seed = 11;
  context.unit_seed = 5;
  context.capture_key = hash_text("train/1");
  context.render = [scene, z0 = context.reference_distance_mm, projector = context.projector_xyz_mm](
                       const View& view, int frame) -> std::shared_ptr<const Channels> {
    const auto light = view.projector_xyz_mm ? view.projector_xyz_mm : projector;
    return analytic_channels(scene, view.camera, light, z0, view.time_s.value_or(0.1 * frame));
  };
  return context;
}

}  // namespace binrig::test
