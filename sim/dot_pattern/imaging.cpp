#include "sim/dot_pattern/imaging.h"

#include <algorithm>
#include <cmath>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "core/ray_table.h"

namespace binrig::dot_pattern {
namespace {

// Normalised image coordinates to where the residual lens puts them.
cv::Point2d through_lens(const Parameters& p, double x, double y) {
  const double r2 = x * x + y * y, radial = 1 + r2 * (p.k1 + r2 * p.k2);
  return {x * radial + 2 * p.p1 * x * y + p.p2 * (r2 + 2 * x * x) + p.prism_x * r2,
          y * radial + p.p1 * (r2 + 2 * y * y) + 2 * p.p2 * x * y + p.prism_y * r2};
}

bool has_residual_lens(const Parameters& p) {
  return p.k1 != 0 || p.k2 != 0 || p.p1 != 0 || p.p2 != 0 || p.prism_x != 0 || p.prism_y != 0;
}

// By fixed-point iteration: each step gains the factor of the distortion's derivative, a few per cent.
cv::Point2d before_lens(const Parameters& p, double x, double y) {
  cv::Point2d ideal(x, y);
  for (int i = 0; i < 12; ++i) {
    const cv::Point2d seen = through_lens(p, ideal.x, ideal.y);
    ideal += cv::Point2d(x - seen.x, y - seen.y);
  }
  return ideal;
}

// Farthest that the lens moves light, px, looked for along the image's rim.
double largest_shift_px(const Parameters& p, const Camera& camera) {
  double largest = 0;
  const auto look = [&](double u, double v) {
    const double x = (u - camera.cx) / camera.fx, y = (v - camera.cy) / camera.fy;
    const cv::Point2d ideal = before_lens(p, x, y);
    largest = std::max({largest, std::abs(ideal.x - x) * camera.fx, std::abs(ideal.y - y) * camera.fy});
  };
  for (int i = 0; i <= 16; ++i) {
    const double u = (camera.width - 1) * i / 16.0, v = (camera.height - 1) * i / 16.0;
    look(u, 0), look(u, camera.height - 1), look(0, v), look(camera.width - 1, v);
  }
  return largest;
}

// The light of the ideal pinhole camera `fine`.
cv::Mat ideal_light(const RenderScene& scene, const Camera& fine, const Exposure& e, const Pattern& pattern,
                    const Parameters& parameters, const Renderer& renderer) {
  RenderRequest request;
  request.camera = fine;
  request.projector_xyz_mm = e.projector_mm;
  request.reference_distance_mm = e.reference_distance_mm;
  request.wanted = Channel::depth | Channel::normal | Channel::diffuse | Channel::specular | Channel::projector_gap;
  const auto channels = renderer.render(scene, request);
  const cv::Mat rays = ray_table(fine);
  const ImageCoordinates coordinates(fine);
  const double cos_yaw = std::cos(e.projector_yaw_rad), sin_yaw = std::sin(e.projector_yaw_rad);
  const double z0_squared = e.reference_distance_mm * e.reference_distance_mm;
  cv::Mat light = cv::Mat::zeros(fine.height, fine.width, CV_32F);
  parallel_for(fine.height, [&](int v) {
    const float* depth = channels->depth_mm.ptr<float>(v);
    const float* diffuse = channels->diffuse.ptr<float>(v);
    const float* specular = channels->specular.ptr<float>(v);
    const float* gap = channels->projector_gap_mm.empty() ? nullptr : channels->projector_gap_mm.ptr<float>(v);
    const auto* normal = channels->normal.ptr<cv::Vec3f>(v);
    const auto* ray = rays.ptr<cv::Vec2f>(v);
    float* out = light.ptr<float>(v);
    for (int u = 0; u < fine.width; ++u) {
      const double z = depth[u];
      if (z <= 0) continue;
      const double x = ray[u][0] * z - e.projector_mm.x(), y = ray[u][1] * z - e.projector_mm.y(),
                   w = z - e.projector_mm.z();
      float sum = 0;
      const double ahead = x * sin_yaw + w * cos_yaw;
      if (ahead > 0 && (!gap || gap[u] <= shadow_epsilon_mm)) {
        const double column = e.pattern_camera.fx * (x * cos_yaw - w * sin_yaw) / ahead + e.pattern_camera.cx,
                     row = e.pattern_camera.fy * y / ahead + e.pattern_camera.cy;
        sum = pattern.at(static_cast<float>(column), static_cast<float>(row)) * (diffuse[u] + 0.5f * specular[u]);
      }
      const double distance_squared = x * x + y * y + w * w;
      const double cosine = -(normal[u][0] * x + normal[u][1] * y + normal[u][2] * w) / std::sqrt(distance_squared);
      if (cosine > 0.02) {  // the surface's own albedo, without the projector's angle and distance
        const double albedo = diffuse[u] / cosine * distance_squared / z0_squared;
        const double dx = coordinates.x(u) - parameters.spot_x, dy = coordinates.y(v) - parameters.spot_y;
        const double spot = parameters.ambient_spot > 0
                                ? parameters.ambient_spot * std::exp(-0.5 * (dx * dx + dy * dy) /
                                                                     (parameters.spot_radius * parameters.spot_radius))
                                : 0;
        sum += static_cast<float>(albedo * (parameters.ambient + spot));
      }
      out[u] = sum;
    }
  });
  return light;
}

}  // namespace

cv::Mat irradiance(const RenderScene& scene, const Exposure& e, const Pattern& pattern, const Parameters& parameters,
                   const Renderer& renderer) {
  const bool lens = e.residual_lens && has_residual_lens(parameters);
  const int blur_reach = static_cast<int>(std::ceil(4 * parameters.optics_sigma));
  const int margin = blur_reach + (lens ? static_cast<int>(std::ceil(largest_shift_px(parameters, e.camera))) + 2 : 0);
  Camera wide = e.camera;  // light from just outside the image is blurred and bent into it
  wide.width += 2 * margin, wide.height += 2 * margin;
  wide.cx += margin, wide.cy += margin;
  const int fineness = static_cast<int>(parameters.supersampling);
  const Camera fine = wide.resized(wide.width * fineness, wide.height * fineness);

  cv::Mat light = ideal_light(scene, fine, e, pattern, parameters, renderer);
  if (lens) {
    cv::Mat from(light.size(), CV_32FC2);
    parallel_for(from.rows, [&](int v) {
      for (int u = 0; u < from.cols; ++u) {
        const cv::Point2d ideal = before_lens(parameters, (u - fine.cx) / fine.fx, (v - fine.cy) / fine.fy);
        from.at<cv::Vec2f>(v, u) =
            cv::Vec2f(static_cast<float>(ideal.x * fine.fx + fine.cx), static_cast<float>(ideal.y * fine.fy + fine.cy));
      }
    });
    cv::Mat bent;
    cv::remap(light, bent, from, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    light = cv::max(bent, 0.f);
  }
  cv::Mat averaged;
  cv::resize(light, averaged, cv::Size(wide.width, wide.height), 0, 0, cv::INTER_AREA);
  if (blur_reach > 0) {
    cv::GaussianBlur(averaged, averaged, cv::Size(2 * blur_reach + 1, 2 * blur_reach + 1), parameters.optics_sigma);
  }
  return averaged(cv::Rect(margin, margin, e.camera.width, e.camera.height)).clone();
}

cv::Mat record(const cv::Mat& irradiance, const Parameters& p, const RandomStream& draws) {
  cv::Mat noise(irradiance.size(), CV_32F);
  draws.fill_normal(noise);
  cv::Mat counts(irradiance.size(), CV_16U);
  const float electrons = static_cast<float>(p.exposure * p.full_well), full = static_cast<float>(p.full_well);
  const float read_variance = static_cast<float>(p.read_noise * p.read_noise);
  const float full_scale = std::exp2(static_cast<float>(p.bits)) - 1;
  parallel_for(irradiance.rows, [&](int v) {
    const float* light = irradiance.ptr<float>(v);
    const float* n = noise.ptr<float>(v);
    auto* out = counts.ptr<std::uint16_t>(v);
    for (int u = 0; u < irradiance.cols; ++u) {
      const float mean = light[u] * electrons;
      const float held = std::clamp(mean + n[u] * std::sqrt(mean + read_variance), 0.f, full);
      out[u] = static_cast<std::uint16_t>(held / full * full_scale + 0.5f);
    }
  });
  return counts;
}

cv::Mat dead_pixel_map(cv::Size size, double share, const RandomStream& unit_draws) {
  cv::Mat map = cv::Mat::zeros(size, CV_8U);
  if (share <= 0) return map;
  cv::Mat draws(size, CV_32F);
  unit_draws.fill_uniform(draws);
  map.setTo(1, draws < share);
  map.setTo(2, draws < share / 2);
  return map;
}

cv::Mat dust_map(const Camera& camera, const Parameters& p) {
  if (p.dust_radius <= 0 || p.dust_opacity <= 0) return {};
  const double u0 = camera.cx + p.dust_x * camera.width / 2, v0 = camera.cy + p.dust_y * camera.width / 2;
  const double rim = std::max(1.0, 0.2 * p.dust_radius);  // out of focus, so its edge is soft
  cv::Mat map(camera.height, camera.width, CV_32F);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double inside = 0.5 * (1 - std::tanh((std::hypot(u - u0, v - v0) - p.dust_radius) / rim));
      map.at<float>(v, u) = static_cast<float>(1 - p.dust_opacity * inside);
    }
  }
  return map;
}

}  // namespace binrig::dot_pattern
