// The sensor on anybody's perfect depth: what else there is to know of a scene, taken from the depth image itself.
#include <algorithm>
#include <cmath>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/ray_table.h"
#include "sim/sensor.h"

namespace binrig {

namespace {
constexpr float same_surface_mm = 8.f;  // a larger step between neighbours is a depth edge, as in EFFECTS.md
constexpr float behind_mm = 0.02f;      // nearer than this to the surface is on it
constexpr float assumed_albedo = 0.5f;
constexpr int band_rows = 8;

template <typename Body>
void for_rows(int rows, const Body& body) {
  parallel_for((rows + band_rows - 1) / band_rows, [&](int band) {
    for (int row = band * band_rows; row < std::min(rows, (band + 1) * band_rows); ++row) body(row);
  });
}

cv::Vec3f point(const cv::Mat& depth, const cv::Mat& rays, int row, int col) {
  const float z = depth.at<float>(row, col);
  const auto& ray = rays.at<cv::Vec2f>(row, col);
  return {ray[0] * z, ray[1] * z, z};
}

// The tangent through a pixel along (d_row, d_col): between its two neighbours where the depth runs on evenly, else to
// the one that is nearer in depth. Zero where there is none.
cv::Vec3f tangent(const cv::Mat& depth, const cv::Mat& rays, int row, int col, int d_row, int d_col) {
  const float z = depth.at<float>(row, col);
  const auto there = [&](int r, int c) {
    return r >= 0 && c >= 0 && r < depth.rows && c < depth.cols && depth.at<float>(r, c) > 0.f;
  };
  const bool has_next = there(row + d_row, col + d_col), has_last = there(row - d_row, col - d_col);
  const float next = has_next ? std::abs(depth.at<float>(row + d_row, col + d_col) - z) : 1e9f;
  const float last = has_last ? std::abs(depth.at<float>(row - d_row, col - d_col) - z) : 1e9f;
  const cv::Vec3f here = point(depth, rays, row, col);
  if (has_next && has_last && std::abs(next - last) < 0.25f * (next + last) + 0.05f) {
    return point(depth, rays, row + d_row, col + d_col) - point(depth, rays, row - d_row, col - d_col);
  }
  if (has_next && next <= last) return point(depth, rays, row + d_row, col + d_col) - here;
  if (has_last) return here - point(depth, rays, row - d_row, col - d_col);
  return {0.f, 0.f, 0.f};
}

cv::Mat normals_of(const cv::Mat& depth, const cv::Mat& rays) {
  cv::Mat normal = cv::Mat::zeros(depth.size(), CV_32FC3);
  for_rows(depth.rows, [&](int row) {
    for (int col = 0; col < depth.cols; ++col) {
      if (depth.at<float>(row, col) <= 0.f) continue;
      const auto& ray = rays.at<cv::Vec2f>(row, col);
      const cv::Vec3f view(ray[0], ray[1], 1.f);
      cv::Vec3f n = tangent(depth, rays, row, col, 0, 1).cross(tangent(depth, rays, row, col, 1, 0));
      const auto length = static_cast<float>(cv::norm(n));
      n = length > 0.f ? n / length : -view / static_cast<float>(cv::norm(view));  // a lonely pixel faces the camera
      normal.at<cv::Vec3f>(row, col) = n.dot(view) > 0.f ? -n : n;
    }
  });
  return normal;
}

// How far a point lies behind the first surface on the way from the projector, as far as the camera saw it: the way is
// followed through the image in steps of a pixel. Inverse depth is linear along it, and so it is along flat surfaces. A
// surface counts only where the way passes through it from behind; where it comes out from behind a silhouette there is
// no surface that the camera saw.
float gap_of(const cv::Mat& depth, const Camera& camera, const Vector3& projector, const Vector3& p, int row, int col,
             double nearest_mm) {
  const double towards = p.z() - projector.z();
  if (towards <= 0 || p.z() <= nearest_mm) return 0.f;
  const double last_share = std::min(0.999, (p.z() - nearest_mm) / towards);
  const Vector3 last = p + last_share * (projector - p);
  const Eigen::Vector2d from(col, row), to = camera.project(last);
  const Eigen::Vector2d along = to - from;
  const int steps = static_cast<int>(std::ceil(std::max(std::abs(along.x()), std::abs(along.y()))));
  if (steps == 0 || !along.allFinite()) return 0.f;
  const double w_from = 1 / p.z(), w_to = 1 / last.z();
  bool behind = false;
  float previous = static_cast<float>(p.z());
  double reached_w = 0;
  for (int k = 1; k <= steps; ++k) {
    const double share = static_cast<double>(k) / steps;
    const Eigen::Vector2d at = from + share * along;
    const int c = static_cast<int>(std::lround(at.x())), r = static_cast<int>(std::lround(at.y()));
    if (c < 0 || r < 0 || c >= depth.cols || r >= depth.rows) break;
    const float surface = depth.at<float>(r, c);
    const double w = w_from + share * (w_to - w_from);
    if (surface <= 0.f) {
      behind = false;
      previous = 0.f;
      continue;
    }
    const double hidden = 1 / w - surface;  // > 0: the way is behind what the camera sees here
    if (hidden > behind_mm) {
      behind = true;
    } else if (behind) {
      behind = false;
      if (previous > 0.f && std::abs(surface - previous) < same_surface_mm) reached_w = w;
    }
    previous = surface;
  }
  if (reached_w <= 0) return 0.f;
  // Share of the way that was gone when the depth was 1 / reached_w.
  const double share = (p.z() - 1 / reached_w) / towards;
  return static_cast<float>(share * (projector - p).norm());
}

cv::Mat gaps_of(const cv::Mat& depth, const cv::Mat& rays, const Camera& camera, const Vector3& projector) {
  double nearest = 1e9;
  for (int row = 0; row < depth.rows; ++row) {
    const auto* z = depth.ptr<float>(row);
    for (int col = 0; col < depth.cols; ++col) {
      if (z[col] > 0.f) nearest = std::min<double>(nearest, z[col]);
    }
  }
  cv::Mat gap = cv::Mat::zeros(depth.size(), CV_32F);
  for_rows(depth.rows, [&](int row) {
    for (int col = 0; col < depth.cols; ++col) {
      if (depth.at<float>(row, col) <= 0.f) continue;
      const cv::Vec3f p = point(depth, rays, row, col);
      gap.at<float>(row, col) = gap_of(depth, camera, projector, Vector3(p[0], p[1], p[2]), row, col, nearest);
    }
  });
  return gap;
}

double median_of(const cv::Mat& depth) {
  std::vector<float> values;
  for (int row = 0; row < depth.rows; row += 2) {
    for (int col = 0; col < depth.cols; col += 2) {
      if (depth.at<float>(row, col) > 0.f) values.push_back(depth.at<float>(row, col));
    }
  }
  if (values.empty()) return 800;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}
}  // namespace

std::shared_ptr<const Channels> channels_from_depth(const cv::Mat& perfect_depth_mm, const Camera& camera,
                                                    const std::optional<Vector3>& projector_xyz_mm,
                                                    double reference_distance_mm, ChannelSet wanted) {
  Violations violations;
  if (perfect_depth_mm.type() != CV_32F) violations.add("perfect depth", "type", "must be CV_32F, in mm");
  if (perfect_depth_mm.cols != camera.width || perfect_depth_mm.rows != camera.height) {
    violations.add("perfect depth", "size", "is not the camera's");
  }
  violations.throw_if_any("This depth image cannot be used.");
  camera.check("camera");
  const auto want = [&](Channel c) { return contains(wanted, c); };
  auto channels = std::make_shared<Channels>();
  Channels& out = *channels;
  out.camera = camera;
  out.depth_mm = perfect_depth_mm.clone();
  for (int row = 0; row < out.depth_mm.rows; ++row) {
    auto* z = out.depth_mm.ptr<float>(row);
    for (int col = 0; col < out.depth_mm.cols; ++col) {
      if (!(z[col] > 0.f) || !std::isfinite(z[col])) z[col] = 0.f;
    }
  }
  const cv::Mat rays = ray_table(camera);
  const cv::Size size = out.depth_mm.size();
  const bool light = want(Channel::diffuse) || want(Channel::ir);
  const bool edges = want(Channel::edge_distance) || want(Channel::crease_distance);
  if (want(Channel::normal) || want(Channel::cos_incidence) || light || edges)
    out.normal = normals_of(out.depth_mm, rays);
  if (projector_xyz_mm && (want(Channel::projector_gap) || want(Channel::ir))) {
    out.projector_gap_mm = gaps_of(out.depth_mm, rays, camera, *projector_xyz_mm);
  }
  if (want(Channel::instance)) {
    cv::Mat there = out.depth_mm > 0.f;
    there.convertTo(out.instance, CV_16U, 1.0 / 255);
  }
  if (want(Channel::specular)) out.specular = cv::Mat::zeros(size, CV_32F);
  if (want(Channel::cos_incidence)) out.cos_incidence = cv::Mat::zeros(size, CV_32F);
  if (light) out.diffuse = cv::Mat::zeros(size, CV_32F);
  if (want(Channel::ir)) out.ir = cv::Mat::zeros(size, CV_32F);
  const Vector3 at = projector_xyz_mm.value_or(Vector3::Zero());
  const cv::Vec3f source(static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(at.z()));
  const auto z0 = static_cast<float>(reference_distance_mm);
  if (want(Channel::cos_incidence) || light) {
    for_rows(size.height, [&](int row) {
      for (int col = 0; col < size.width; ++col) {
        if (out.depth_mm.at<float>(row, col) <= 0.f) continue;
        const cv::Vec3f n = out.normal.at<cv::Vec3f>(row, col), p = point(out.depth_mm, rays, row, col);
        if (want(Channel::cos_incidence)) {
          out.cos_incidence.at<float>(row, col) = std::clamp(-n.dot(p) / static_cast<float>(cv::norm(p)), 0.f, 1.f);
        }
        if (!light) continue;
        const cv::Vec3f to_light = source - p;
        const float r2 = to_light.dot(to_light);
        const float diffuse = assumed_albedo * std::max(0.f, n.dot(to_light)) / std::sqrt(r2) * z0 * z0 / r2;
        out.diffuse.at<float>(row, col) = diffuse;
        const bool lit = out.projector_gap_mm.empty() || out.projector_gap_mm.at<float>(row, col) <= shadow_epsilon_mm;
        if (want(Channel::ir)) out.ir.at<float>(row, col) = lit ? diffuse : 0.f;
      }
    });
  }
  if (edges) add_edge_channels(out, wanted);
  if (!want(Channel::normal)) out.normal.release();
  if (!want(Channel::diffuse)) out.diffuse.release();
  if (!want(Channel::projector_gap)) out.projector_gap_mm.release();
  return channels;
}

Frame apply_sensor(const SensorModel& model, const cv::Mat& perfect_depth_mm, const Camera& camera, std::uint64_t seed,
                   int frame_number) {
  CaptureContext context;
  context.camera = camera;
  if (model.projector_known) context.projector_xyz_mm = model.projector_xyz_mm;
  if (model.reference_from == Given::written) {
    context.reference_distance_mm = model.reference_distance_mm;
  } else if (model.range_mm) {
    context.reference_distance_mm = ((*model.range_mm)[0] + (*model.range_mm)[1]) / 2;
  } else if (perfect_depth_mm.type() == CV_32F) {
    context.reference_distance_mm = median_of(perfect_depth_mm);
  }
  context.depth_scale_mm = model.depth_scale_from == Given::written ? model.depth_scale_mm : 0;
  context.seed = seed;
  context.unit_seed = model.unit_seed;
  SensorRun run(model, context);
  const auto channels = channels_from_depth(perfect_depth_mm, camera, context.projector_xyz_mm,
                                            context.reference_distance_mm, SensorRun::needed_channels(model, true));
  FrameInstant instant;
  instant.number = frame_number;
  if (model.frame_rate_hz) instant.time_s = frame_number / *model.frame_rate_hz;
  return run.frame(*channels, instant);
}

}  // namespace binrig
