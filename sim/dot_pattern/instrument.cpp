#include "sim/dot_pattern/instrument.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "sim/dot_pattern/imaging.h"
#include "sim/dot_pattern/matcher.h"

namespace binrig::dot_pattern {
namespace {

bool same_scene(const RenderScene& a, const RenderScene& b) {
  const auto same_object = [](const SceneObject& p, const SceneObject& q) {
    return p.mesh == q.mesh && p.X_CO.matrix() == q.X_CO.matrix();
  };
  if (!std::equal(a.objects.begin(), a.objects.end(), b.objects.begin(), b.objects.end(), same_object)) return false;
  if (a.plane.has_value() != b.plane.has_value()) return false;
  return !a.plane || (a.plane->normal == b.plane->normal && a.plane->offset_mm == b.plane->offset_mm &&
                      a.plane->surface.albedo == b.plane->surface.albedo);
}

// The scene in the frame D of another camera, p_D = turn (p_C - place).
RenderScene seen_from(const RenderScene& scene, const Eigen::Matrix3d& turn, const Vector3& place) {
  RenderScene moved = scene;
  Pose X_DC = Pose::Identity();
  X_DC.linear() = turn;
  X_DC.translation() = -(turn * place);
  for (SceneObject& object : moved.objects) object.X_CO = X_DC * object.X_CO;
  if (moved.plane) {
    moved.plane->normal = turn * scene.plane->normal;
    moved.plane->offset_mm = scene.plane->offset_mm - scene.plane->normal.dot(place);
  }
  return moved;
}

void check(const Geometry& geometry, const SensorModel& model) {
  const std::string where = model.file.empty() ? model.name : model.file;
  Violations violations;
  geometry.nominal.check(where);
  if (geometry.nominal.distorted()) {
    violations.add(where, "camera", "the instrument delivers rectified images: the camera must have no distortion");
  }
  const Vector3& b = geometry.second_view_mm;
  if (std::abs(b.x()) < 1 || std::abs(b.y()) > 1e-6 || std::abs(b.z()) > 1e-6) {
    violations.add({where, "projector", fmt::format("{:g} {:g} {:g}", b.x(), b.y(), b.z()), "mm", "|x| >= 1, y = z = 0",
                    "must stand beside the camera on its x axis"});
  }
  const auto [near, far] = geometry.range_mm;
  if (!(near > 0 && far > near)) {
    violations.add({where, "range_mm", fmt::format("{:g} .. {:g}", near, far), "mm", "", "must be 0 < near < far"});
  }
  violations.throw_if_any("the instrument cannot be set up");
}

}  // namespace

struct Instrument::Impl {
  Parameters parameters;
  Geometry geometry;
  const Renderer& renderer;
  Camera believed, actual;  // at the matched resolution
  double focal_baseline = 0;
  MatchSettings matching;
  std::unique_ptr<Pattern> pattern;
  cv::Mat reference;  // structured light: the stored image
  int right_origin = 0;
  cv::Mat dead, dust;

  std::optional<RenderScene> last_scene;
  double last_yaw = 0;
  cv::Mat left_light, right_light;  // irradiance of last_scene
  cv::Mat left_blend, right_blend;  // CV_32F, counts before rounding
  cv::Mat left, right;

  Impl(const SensorModel& model, const Geometry& s, const Renderer& r)
      : parameters(read_parameters(model)), geometry(s), renderer(r) {
    check(geometry, model);
    const int binning = static_cast<int>(parameters.binning);
    believed = geometry.nominal.resized(geometry.nominal.width * binning, geometry.nominal.height * binning);
    actual = geometry.actual.resized(believed.width, believed.height);
    focal_baseline = believed.fx * geometry.second_view_mm.x();
    const double a = focal_baseline / geometry.range_mm[0], b = focal_baseline / geometry.range_mm[1];
    matching.lowest_px = static_cast<int>(std::floor(std::min(a, b))) - 2;
    matching.highest_px = static_cast<int>(std::ceil(std::max(a, b))) + 2;
    if (matching.highest_px - matching.lowest_px > 2000) {
      throw Error(fmt::format("the range {:g} .. {:g} mm spans {} disparities of the matched image: more than 2000",
                              geometry.range_mm[0], geometry.range_mm[1], matching.highest_px - matching.lowest_px));
    }
    matching.cost = parameters.cost;
    matching.window_px = static_cast<int>(parameters.window);
    matching.min_correlation = parameters.min_correlation;
    matching.uniqueness = parameters.uniqueness;
    matching.max_left_right_px = parameters.max_left_right;
    matching.speckle_size_px = static_cast<int>(parameters.speckle_size);
    matching.speckle_step_px = parameters.speckle_step;
    matching.full_scale = (1 << static_cast<int>(parameters.bits)) - 1;
    matching.min_contrast = parameters.min_contrast;
    matching.saturated_share = parameters.saturated_share;
    matching.disparity_step_px = parameters.disparity_step;

    // Columns of the pattern that light up what the camera sees within the range.
    const bool active = parameters.principle == Principle::active_stereo;
    const double share = active ? parameters.projector_share : 1.0;
    const int reach = matching.window_px + 8;
    const int first =
        static_cast<int>(std::floor(-std::max(share * matching.highest_px, share * matching.lowest_px))) - reach;
    const int last = believed.width + static_cast<int>(std::ceil(-share * matching.lowest_px)) + reach;
    pattern = std::make_unique<Pattern>(parameters, first, last - first, believed.height);
    if (active) {  // both cameras look at the same part of the reference plane, as rectified pairs do
      right_origin = -static_cast<int>(std::lround(focal_baseline / geometry.reference_distance_mm));
    } else {
      right_origin = -matching.highest_px - reach;
      const int columns = believed.width + matching.highest_px - matching.lowest_px + 2 * reach;
      reference =
          pattern->image(right_origin, columns, believed.height, parameters.optics_sigma, matching.full_scale / 2);
    }
    dead = dead_pixel_map(cv::Size(believed.width, believed.height), parameters.dead_pixels,
                          unit_stream(geometry.unit_seed, "dot_pattern.dead_pixels"));
    dust = dust_map(believed, parameters);
  }

  void expose(const RenderScene& scene, double yaw) {
    if (last_scene && last_yaw == yaw && same_scene(*last_scene, scene)) return;
    const Vector3 second = geometry.second_view_mm + Vector3(parameters.baseline_error, 0, 0);
    const bool active = parameters.principle == Principle::active_stereo;
    Exposure exposure;
    exposure.camera = actual;
    exposure.pattern_camera = believed;
    exposure.reference_distance_mm = geometry.reference_distance_mm;
    exposure.projector_mm = active ? Vector3(parameters.projector_share * geometry.second_view_mm) : second;
    exposure.projector_yaw_rad = active ? 0 : yaw;
    left_light = irradiance(scene, exposure, *pattern, parameters, renderer);
    if (!dust.empty()) left_light = left_light.mul(dust);
    if (active) {
      Eigen::Matrix3d turn;
      turn << std::cos(yaw), 0, -std::sin(yaw), 0, 1, 0, std::sin(yaw), 0, std::cos(yaw);
      Exposure other = exposure;
      other.projector_mm = turn * (exposure.projector_mm - second);
      other.projector_yaw_rad = -yaw;
      other.residual_lens = false;
      other.camera.cx -= right_origin;
      right_light = irradiance(seen_from(scene, turn, second), other, *pattern, parameters, renderer);
    }
    last_scene = scene;
    last_yaw = yaw;
  }

  // A recorded image, blended with the one before where the sensor lags.
  cv::Mat take(const cv::Mat& light, const RandomStream& draws, const cv::Mat& dead_map, cv::Mat& blend) const {
    cv::Mat counts = record(light, parameters, draws);
    if (!dead_map.empty()) {
      counts.setTo(0, dead_map == 1);
      counts.setTo(matching.full_scale, dead_map == 2);
    }
    if (parameters.frame_blend >= 1) return counts;
    cv::Mat values;
    counts.convertTo(values, CV_32F);
    if (blend.empty()) {
      blend = values;
    } else {
      blend = parameters.frame_blend * values + (1 - parameters.frame_blend) * blend;
    }
    blend.convertTo(counts, CV_16U);
    return counts;
  }

  // Depth and reason of one pixel of the depth image from its block of the matched one.
  void bin(const Matches& matches, int row, int col, Frame& frame) const {
    const int n = static_cast<int>(parameters.binning);
    std::array<float, 64> valid;
    std::array<int, reason_count> votes{};
    int count = 0;
    for (int v = row * n; v < (row + 1) * n; ++v) {
      for (int u = col * n; u < (col + 1) * n; ++u) {
        const auto reason = matches.reason.at<std::uint8_t>(v, u);
        if (reason == 0) {
          valid[count++] = matches.disparity_px.at<float>(v, u);
        } else {
          ++votes[reason];
        }
      }
    }
    auto& why = frame.reason.at<std::uint8_t>(row, col);
    auto& depth = frame.depth_mm.at<float>(row, col);
    depth = 0;
    if (2 * count < n * n) {
      why = static_cast<std::uint8_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
      return;
    }
    std::sort(valid.begin(), valid.begin() + count);
    double disparity = valid[count / 2];
    if (count % 2 == 0) {  // between two surfaces the nearer one, never a depth that nobody has
      const double below = valid[count / 2 - 1];
      disparity = disparity - below < 1 ? 0.5 * (disparity + below) : (focal_baseline > 0 ? disparity : below);
    }
    double z = disparity * focal_baseline > 0 ? focal_baseline / disparity : 0;
    if (z < geometry.range_mm[0] || z > geometry.range_mm[1]) {
      why = static_cast<std::uint8_t>(Reason::out_of_range);
      return;
    }
    if (geometry.depth_scale_mm > 0) z = std::round(z / geometry.depth_scale_mm) * geometry.depth_scale_mm;
    why = 0;
    depth = static_cast<float>(z);
  }
};

Instrument::Instrument(const SensorModel& model, const Geometry& geometry, const Renderer& renderer)
    : impl_(std::make_unique<Impl>(model, geometry, renderer)) {}
Instrument::~Instrument() = default;

cv::Mat Instrument::left_image() const { return impl_->left; }
cv::Mat Instrument::right_image() const { return impl_->right; }

Frame Instrument::frame(const RenderScene& scene, int number, double since_power_on_s) {
  Impl& m = *impl_;
  const Parameters& p = m.parameters;
  double yaw = p.yaw_error;
  if (std::isfinite(since_power_on_s)) yaw += p.yaw_drift * std::exp(-since_power_on_s / p.drift_time);
  m.expose(scene, yaw);
  const RandomStream draws = frame_stream(m.geometry.seed, m.geometry.capture_key, number, "dot_pattern");
  m.left = m.take(m.left_light, draws.child("left"), m.dead, m.left_blend);
  m.right = p.principle == Principle::active_stereo ? m.take(m.right_light, draws.child("right"), {}, m.right_blend)
                                                    : m.reference;
  const Matches matches = match_blocks(m.left, m.right, m.right_origin, m.matching);

  Frame frame;
  frame.camera = m.geometry.nominal;
  frame.depth_scale_mm = m.geometry.depth_scale_mm;
  const cv::Size size(m.geometry.nominal.width, m.geometry.nominal.height);
  frame.depth_mm.create(size, CV_32F);
  frame.reason.create(size, CV_8U);
  parallel_for(size.height, [&](int row) {
    for (int col = 0; col < size.width; ++col) m.bin(matches, row, col, frame);
  });
  cv::Mat ir;
  cv::resize(m.left, ir, size, 0, 0, cv::INTER_AREA);
  ir.convertTo(frame.ir, CV_16U, 65535.0 / m.matching.full_scale);
  return frame;
}

}  // namespace binrig::dot_pattern
