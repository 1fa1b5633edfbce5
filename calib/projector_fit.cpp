#include "calib/projector_fit.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "core/progress.h"

namespace binrig {
namespace {

struct Target {
  int capture = 0;
  cv::Mat missing;  ///< CV_8U, not 0 where a pixel with geometry has no depth
  cv::Mat counted;  ///< CV_8U, not 0 where a pixel says something
};

constexpr float cos_65_deg = 0.4226f;

std::vector<Target> targets_of(const ForwardModel& forward, const RecordingSet& set, const SensorModel& model) {
  std::vector<Target> targets;
  for (std::size_t i = 0; i < forward.captures().size(); ++i) {
    const CaptureInfo& info = forward.captures()[i];
    if (info.split != "train" || info.target != TargetKind::scene) continue;
    const auto channels = forward.perfect(static_cast<int>(i), 0, Offset{},
                                          Channel::depth | Channel::cos_incidence | Channel::normal | Channel::edge_distance, model);
    const Frame frame = set.capture(info.key()).frame(0);
    Target target;
    target.capture = static_cast<int>(i);
    target.counted = (channels->depth_mm > 0) & (channels->cos_incidence > cos_65_deg);
    if (!set.info().valid_region.empty()) target.counted &= set.info().valid_region;
    target.missing = (frame.depth_mm == 0) & target.counted;
    if (cv::countNonZero(target.missing & (channels->edge_px < 60)) >= 200) targets.push_back(target);
  }
  return targets;
}

struct Overlap {
  double both = 0, either = 0, predicted = 0, missing = 0, counted = 0;
  double iou() const { return either > 0 ? both / either : 0; }
  /// How much likelier a pixel is missing where shadow is predicted than anywhere.
  double lift() const { return predicted > 0 && missing > 0 ? both / predicted / (missing / counted) : 0; }
};

Overlap overlap_at(const ForwardModel& forward, const std::vector<Target>& targets, SensorModel model, const Vector3& place) {
  model.projector_from = Given::fit;
  model.projector_known = true;
  model.projector_xyz_mm = place;
  Overlap sum;
  for (const Target& target : targets) {
    const auto channels = forward.perfect(target.capture, 0, Offset{}, Channel::depth | Channel::projector_gap, model);
    const cv::Mat shadow = (channels->projector_gap_mm > 1.f) & target.counted;
    sum.both += cv::countNonZero(shadow & target.missing);
    sum.either += cv::countNonZero(shadow | target.missing);
    sum.predicted += cv::countNonZero(shadow);
    sum.missing += cv::countNonZero(target.missing);
    sum.counted += cv::countNonZero(target.counted);
  }
  return sum;
}

// Nelder and Mead's simplex (1965) in three dimensions, to a spread of half a millimetre.
Vector3 simplex_minimum(const std::function<double(const Vector3&)>& cost, const Vector3& start, const Vector3& steps) {
  struct Vertex {
    Vector3 x;
    double f;
  };
  std::vector<Vertex> v{{start, cost(start)}};
  for (int i = 0; i < 3; ++i) {
    Vector3 x = start;
    x[i] += steps[i];
    v.push_back({x, cost(x)});
  }
  for (int iteration = 0; iteration < 80; ++iteration) {
    std::sort(v.begin(), v.end(), [](const Vertex& a, const Vertex& b) { return a.f < b.f; });
    if ((v[3].x - v[0].x).norm() < 0.5) break;
    const Vector3 centre = (v[0].x + v[1].x + v[2].x) / 3;
    const auto at = [&](double factor) {
      const Vector3 x = centre + factor * (v[3].x - centre);
      return Vertex{x, cost(x)};
    };
    const Vertex reflected = at(-1);
    if (reflected.f < v[0].f) {
      const Vertex expanded = at(-2);
      v[3] = expanded.f < reflected.f ? expanded : reflected;
    } else if (reflected.f < v[2].f) {
      v[3] = reflected;
    } else {
      const Vertex contracted = at(0.5);
      if (contracted.f < v[3].f) {
        v[3] = contracted;
      } else {
        for (int i = 1; i < 4; ++i) {
          v[i].x = 0.5 * (v[i].x + v[0].x);
          v[i].f = cost(v[i].x);
        }
      }
    }
  }
  return v[0].x;
}

}  // namespace

ProjectorFit fit_projector(const ForwardModel& forward, const RecordingSet& set, const SensorModel& model) {
  ProjectorFit fit;
  const std::vector<Target> targets = targets_of(forward, set, model);
  if (targets.empty()) {
    fit.message = "no train capture shows a shadow beside a depth edge: the projector's place stays unknown";
    return fit;
  }
  for (const Target& target : targets) fit.captures.push_back(forward.captures()[target.capture].key());

  std::vector<double> grid;
  for (double x = 12.5; x <= 150; x += 12.5) {
    grid.push_back(x);
    grid.push_back(-x);
  }
  std::vector<double> scores(grid.size());
  Progress progress("finding the projector", static_cast<std::int64_t>(grid.size()));
  parallel_for(static_cast<int>(grid.size()), [&](int i) {
    scores[i] = overlap_at(forward, targets, model, Vector3(grid[i], 0, 0)).iou();
    progress.advance();
  });
  const std::size_t best = std::max_element(scores.begin(), scores.end()) - scores.begin();
  // Far along the optical axis and across the baseline the shadows say little: a weak prior of 15 mm about the image
  // plane keeps the simplex from wandering there for a handful of pixels.
  const auto cost = [&](const Vector3& place) {
    return -overlap_at(forward, targets, model, place).iou() + 2e-5 * (place.y() * place.y() + place.z() * place.z()) / 2;
  };
  fit.xyz_mm = simplex_minimum(cost, Vector3(grid[best], 0, 0), Vector3(6, 6, 6));
  const Overlap overlap = overlap_at(forward, targets, model, fit.xyz_mm);
  fit.iou = overlap.iou();
  if (overlap.lift() < 3) {
    fit.message = fmt::format("no place of a projector explains the missing pixels (best IoU {:.2f}; in its shadow a pixel is "
                              "missing only {:.1f} times as often as anywhere)", fit.iou, overlap.lift());
    return fit;
  }
  fit.found = true;
  // Misfit in pixels against displacement: the place is as uncertain as it takes to lose sqrt(pixels) of agreement
  // (shadow edges are runs of pixels that agree or fail together).
  for (int axis = 0; axis < 3; ++axis) {
    fit.sigma_mm[axis] = std::numeric_limits<double>::infinity();
    for (double step : {1.0, 2.0, 4.0, 8.0, 16.0, 32.0}) {
      double loss = 0;
      for (double sign : {-1.0, 1.0}) {
        Vector3 place = fit.xyz_mm;
        place[axis] += sign * step;
        loss += 0.5 * (overlap.both - overlap_at(forward, targets, model, place).both);
      }
      if (loss > std::sqrt(std::max(1.0, overlap.both))) {
        fit.sigma_mm[axis] = step;
        break;
      }
    }
  }
  fit.message = fmt::format("projector fitted to the shadows of {} capture(s): x = {:.1f}, y = {:.1f}, z = {:.1f} mm (IoU {:.2f})",
                            targets.size(), fit.xyz_mm.x(), fit.xyz_mm.y(), fit.xyz_mm.z(), fit.iou);
  return fit;
}

}  // namespace binrig
