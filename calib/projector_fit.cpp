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
    const auto channels =
        forward.perfect(static_cast<int>(i), 0, Offset{},
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

using Shadows = std::vector<cv::Mat>;  // one a target

Shadows shadows_of(const ForwardModel& forward, const std::vector<Target>& targets, SensorModel model,
                   const Vector3& place) {
  model.projector_from = Given::fit;
  model.projector_known = true;
  model.projector_xyz_mm = place;
  Shadows shadows;
  for (const Target& target : targets) {
    const auto channels = forward.perfect(target.capture, 0, Offset{}, Channel::depth | Channel::projector_gap, model);
    shadows.push_back((channels->projector_gap_mm > 1.f) & target.counted);
  }
  return shadows;
}

Shadows either(const Shadows& a, const Shadows& b) {
  Shadows both;
  for (std::size_t i = 0; i < a.size(); ++i) both.push_back(a[i] | b[i]);
  return both;
}

Overlap overlap(const std::vector<Target>& targets, const Shadows& shadows) {
  Overlap sum;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    const Target& target = targets[i];
    sum.both += cv::countNonZero(shadows[i] & target.missing);
    sum.either += cv::countNonZero(shadows[i] | target.missing);
    sum.predicted += cv::countNonZero(shadows[i]);
    sum.missing += cv::countNonZero(target.missing);
    sum.counted += cv::countNonZero(target.counted);
  }
  return sum;
}

// What is left where the projector throws no shadow.
std::vector<Target> outside(const std::vector<Target>& targets, const Shadows& shadows) {
  std::vector<Target> left(targets.size());
  for (std::size_t i = 0; i < targets.size(); ++i) {
    left[i].capture = targets[i].capture;
    left[i].counted = targets[i].counted & ~shadows[i];
    left[i].missing = targets[i].missing & ~shadows[i];
  }
  return left;
}

// Nelder and Mead's simplex (1965), to a spread of half a millimetre.
Eigen::VectorXd simplex_minimum(const std::function<double(const Eigen::VectorXd&)>& cost, const Eigen::VectorXd& start,
                                double step) {
  struct Vertex {
    Eigen::VectorXd x;
    double f;
  };
  const auto n = static_cast<std::size_t>(start.size());
  std::vector<Vertex> v{{start, cost(start)}};
  for (std::size_t i = 0; i < n; ++i) {
    Eigen::VectorXd x = start;
    x[static_cast<Eigen::Index>(i)] += step;
    v.push_back({x, cost(x)});
  }
  for (int iteration = 0; iteration < 80; ++iteration) {
    std::sort(v.begin(), v.end(), [](const Vertex& a, const Vertex& b) { return a.f < b.f; });
    if ((v[n].x - v[0].x).norm() < 0.5) break;
    Eigen::VectorXd centre = Eigen::VectorXd::Zero(start.size());
    for (std::size_t i = 0; i < n; ++i) centre += v[i].x / static_cast<double>(n);
    const auto at = [&](double factor) {
      Vertex moved{centre + factor * (v[n].x - centre), 0};
      moved.f = cost(moved.x);
      return moved;
    };
    const Vertex reflected = at(-1);
    if (reflected.f < v[0].f) {
      const Vertex expanded = at(-2);
      v[n] = expanded.f < reflected.f ? expanded : reflected;
    } else if (reflected.f < v[n - 1].f) {
      v[n] = reflected;
    } else {
      const Vertex contracted = at(0.5);
      if (contracted.f < v[n].f) {
        v[n] = contracted;
      } else {
        for (std::size_t i = 1; i <= n; ++i) {
          v[i].x = 0.5 * (v[i].x + v[0].x);
          v[i].f = cost(v[i].x);
        }
      }
    }
  }
  return v[0].x;
}

constexpr double least_lift = 3;

}  // namespace

ProjectorFit fit_projector(const ForwardModel& forward, const RecordingSet& set, const SensorModel& model,
                           bool second_view) {
  ProjectorFit fit;
  const std::vector<Target> targets = targets_of(forward, set, model);
  if (targets.empty()) {
    fit.message = "no train capture shows a shadow beside a depth edge: the projector's place stays unknown";
    return fit;
  }
  for (const Target& target : targets) fit.captures.push_back(forward.captures()[target.capture].key());
  const auto shadows_at = [&](const Vector3& place) { return shadows_of(forward, targets, model, place); };

  std::vector<double> grid;
  for (double x = 12.5; x <= 150; x += 12.5) {
    grid.push_back(x);
    grid.push_back(-x);
  }
  std::vector<Shadows> thrown(grid.size());
  Progress progress("finding the projector", static_cast<std::int64_t>(grid.size()));
  parallel_for(static_cast<int>(grid.size()), [&](int i) {
    thrown[i] = shadows_at(Vector3(grid[i], 0, 0));
    progress.advance();
  });
  // Far along the optical axis and across the baseline the shadows say little: a weak prior of 15 mm about the image
  // plane keeps the simplex from wandering there for a handful of pixels.
  const auto cost = [&](const Shadows& shadows, double y, double z) {
    return -overlap(targets, shadows).iou() + 2e-5 * (y * y + z * z) / 2;
  };
  std::size_t best = 0;
  std::pair<std::size_t, std::size_t> best_pair{0, 0};
  double best_iou = -1, best_pair_iou = -1;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    if (const double iou = overlap(targets, thrown[i]).iou(); iou > best_iou) {
      best_iou = iou;
      best = i;
    }
    for (std::size_t k = 0; second_view && k < grid.size(); ++k) {
      if (std::abs(grid[k]) >= std::abs(grid[i])) continue;  // the projector is the one farther away
      if (const double iou = overlap(targets, either(thrown[i], thrown[k])).iou(); iou > best_pair_iou) {
        best_pair_iou = iou;
        best_pair = {i, k};
      }
    }
  }

  Shadows other;  // the second view's
  if (second_view) {
    const Eigen::VectorXd places = simplex_minimum(
        [&](const Eigen::VectorXd& p) {
          return cost(either(shadows_at(p.head<3>()), shadows_at(Vector3(p[3], 0, 0))), p[1], p[2]);
        },
        Eigen::Vector4d(grid[best_pair.first], 0, 0, grid[best_pair.second]), 6);
    fit.xyz_mm = places.head<3>();
    const Shadows first = shadows_at(fit.xyz_mm), second = shadows_at(Vector3(places[3], 0, 0));
    // The lift of the second shadow where the first one does not reach.
    if (overlap(outside(targets, first), second).lift() >= least_lift) {
      fit.second_x_mm = places[3];
      fit.iou_alone = overlap(targets, first).iou();
      other = second;
    }
  }
  if (!fit.second_x_mm) {
    fit.xyz_mm = simplex_minimum([&](const Eigen::VectorXd& p) { return cost(shadows_at(p), p[1], p[2]); },
                                 Vector3(grid[best], 0, 0), 6);
  }
  const auto with_other = [&](const Shadows& first) { return other.empty() ? first : either(first, other); };
  const Overlap found = overlap(targets, with_other(shadows_at(fit.xyz_mm)));
  fit.iou = found.iou();
  if (found.lift() < least_lift) {
    fit.second_x_mm.reset();
    fit.message = fmt::format(
        "no place of a projector explains the missing pixels (best IoU {:.2f}; in its shadow a pixel is "
        "missing only {:.1f} times as often as anywhere)",
        fit.iou, found.lift());
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
        loss += 0.5 * (found.both - overlap(targets, with_other(shadows_at(place))).both);
      }
      if (loss > std::sqrt(std::max(1.0, found.both))) {
        fit.sigma_mm[axis] = step;
        break;
      }
    }
  }
  fit.message = fmt::format(
      "projector fitted to the shadows of {} capture(s): x = {:.1f}, y = {:.1f}, z = {:.1f} mm (IoU {:.2f})",
      targets.size(), fit.xyz_mm.x(), fit.xyz_mm.y(), fit.xyz_mm.z(), fit.iou);
  if (fit.second_x_mm) {
    fit.message +=
        fmt::format("; a second view at x = {:.1f} mm (without it IoU {:.2f})", *fit.second_x_mm, fit.iou_alone);
  } else if (second_view) {
    fit.message += "; no second shadow found";
  }
  return fit;
}

}  // namespace binrig
