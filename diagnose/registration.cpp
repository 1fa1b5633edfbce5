#include "diagnose/registration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "compare/statistics/grid.h"
#include "core/parallel.h"

namespace binrig {
namespace {

// Of a small motion: rotations (rad), shifts (mm), focal length and principal point (px). Never less than 4 sigmas.
constexpr std::array<double, 9> largest_motion{0.02, 0.02, 0.02, 5, 5, 5, 10, 3, 3};
constexpr double near_rad = 1e-3, near_mm = 0.3;  // to which targets are registered
constexpr float largest_change_mm = 5.f;          // beyond: another surface came into the pixel
constexpr float rounding_mm = 1e-3f;              // of float depth

/// A frame of a capture as its statistics read it: perfect depth of the nominal scene and the pixels that count.
struct SampledFrame {
  int frame = 0;
  std::shared_ptr<const Channels> nominal;
  std::shared_ptr<const CaptureRegions> regions;
};

/// The frames that stand for a capture. One does, unless the target moves: then other pixels are interior in each. What
/// a quarter of all frames see in a row, as much as a bias map asks for, one of five evenly spaced ones sees.
std::vector<SampledFrame> sampled_frames(const Experiment& experiment, int capture) {
  std::vector<SampledFrame> frames{{0, experiment.nominal_at(capture, 0), experiment.regions(capture)}};
  const StatisticContext& context = experiment.context(capture);
  const int last = context.frames - 1, most = std::min(4, last);
  if (!context.motion) return frames;
  for (int i = 1; i <= most; ++i) {
    const int frame = i * last / most;
    const auto nominal = experiment.nominal_at(capture, frame);
    frames.push_back({frame, nominal, std::make_shared<CaptureRegions>(*nominal, context)});
  }
  return frames;
}

/// Bias map's change (mm a sigma, by central difference) for an offset of one sigma and its opposite.
std::vector<std::pair<int, float>> change_of(const Experiment& experiment, const SensorModel& model, int capture,
                                             const std::vector<SampledFrame>& frames, const Offset& plus,
                                             const Offset& minus) {
  const Block* block = experiment.layout().find(capture, "bias");
  if (!block) return {};
  const StatisticContext& context = experiment.context(capture);
  const Grid grid(context, context.bin_px());
  std::vector<double> sums(grid.size()), counts(grid.size());
  const auto wanted = static_cast<ChannelSet>(Channel::depth);
  for (const SampledFrame& sampled : frames) {
    const auto high = experiment.forward().perfect(capture, sampled.frame, plus, wanted, model);
    const auto low = experiment.forward().perfect(capture, sampled.frame, minus, wanted, model);
    cv::Mat change = cv::Mat::zeros(high->depth_mm.size(), CV_32F), mask = cv::Mat::zeros(change.size(), CV_32F);
    const float *nominal = sampled.nominal->depth_mm.ptr<float>(), *interior = sampled.regions->interior.ptr<float>();
    for (std::size_t p = 0; p < change.total(); ++p) {
      const float a = high->depth_mm.ptr<float>()[p], b = low->depth_mm.ptr<float>()[p];
      if (a <= 0 || b <= 0 || interior[p] == 0 || std::abs(a - b) > largest_change_mm) continue;
      // A small step passes through the pixel: it is on one side or on the other, and what smooths depth spreads it.
      if (std::abs(0.5f * (a + b) - nominal[p]) > 0.25f * std::abs(a - b) + rounding_mm) continue;
      change.ptr<float>()[p] = 0.5f * (a - b);
      mask.ptr<float>()[p] = 1;
    }
    grid.add(change, mask, sums);
    grid.add(mask, mask, counts);
  }
  std::vector<std::pair<int, float>> result;
  for (int i = 0; i < grid.size(); ++i)
    if (counts[i] > 0) result.emplace_back(block->offset + i, static_cast<float>(sums[i] / counts[i]));
  return result;
}

void set(Offset& offset, int element, double value) {
  if (element < 6)
    offset.pose[element] = value;
  else
    (element == 6 ? offset.focal_px : element == 7 ? offset.cx_px : offset.cy_px) = value;
}

double get(const Offset& offset, int element) {
  return element < 6    ? offset.pose[element]
         : element == 6 ? offset.focal_px
         : element == 7 ? offset.cx_px
                        : offset.cy_px;
}

}  // namespace

RegistrationPrior registration_prior(const SetInfo& set, const Camera& camera) {
  RegistrationPrior prior;
  prior.focal_px = 0.002 * camera.fx;
  if (set.pose_sigma_mm && !set.poses_fitted_to_this_depth) {
    prior.pose_mm = std::max(1e-3, *set.pose_sigma_mm);
    prior.poses_known = true;
  }
  if (set.pose_sigma_rad && !set.poses_fitted_to_this_depth) prior.pose_rad = std::max(1e-6, *set.pose_sigma_rad);
  if (set.cam_K_sigma_px) {
    prior.intrinsics_known = true;
    prior.focal_px = std::max(1e-3, (*set.cam_K_sigma_px)[0]);
    prior.cx_px = std::max(1e-3, (*set.cam_K_sigma_px)[1]);
    prior.cy_px = std::max(1e-3, (*set.cam_K_sigma_px)[2]);
  }
  return prior;
}

std::vector<SceneMotion> scene_motions(const Experiment& experiment, const SensorModel& model,
                                       const RegistrationPrior& prior) {
  const int captures = experiment.layout().captures;
  std::vector<SceneMotion> motions;
  for (int c = 0; c < captures; ++c)
    for (int k = 0; k < 6; ++k) motions.push_back({c, k, k < 3 ? prior.pose_rad : prior.pose_mm, true, {}});
  const double intrinsics[] = {prior.focal_px, prior.cx_px, prior.cy_px};
  for (int k = 0; k < 3; ++k) motions.push_back({-1, 6 + k, intrinsics[k], prior.intrinsics_known, {}});
  std::vector<std::vector<std::vector<std::pair<int, float>>>> shared(
      3, std::vector<std::vector<std::pair<int, float>>>(captures));
  parallel_for(captures, [&](int c) {
    const std::vector<SampledFrame> frames = sampled_frames(experiment, c);
    for (auto& motion : motions) {
      if (motion.capture >= 0 && motion.capture != c) continue;
      // Rotations of a thousandth and shifts of a millimetre are small, and large against rounding of float depth.
      const double step = motion.element < 3 ? std::max(motion.sigma, 1e-3) : std::max(motion.sigma, 0.5);
      Offset plus, minus;
      set(plus, motion.element, step);
      set(minus, motion.element, -step);
      auto change = change_of(experiment, model, c, frames, plus, minus);
      for (auto& [index, value] : change) value *= static_cast<float>(motion.sigma / step);
      if (motion.capture >= 0)
        motion.change = std::move(change);
      else
        shared[motion.element - 6][c] = std::move(change);
    }
  });
  for (auto& motion : motions)
    if (motion.capture < 0)
      for (const auto& part : shared[motion.element - 6])
        motion.change.insert(motion.change.end(), part.begin(), part.end());
  return motions;
}

double registered_to(const SceneMotion& motion) {
  return motion.capture < 0 ? 1 : std::min(1.0, (motion.element < 3 ? near_rad : near_mm) / motion.sigma);
}

double left_open(const SceneMotion& motion) {
  constexpr double noise_mm = 1;  // of an element of the bias map, at most
  double shown = 0;
  for (const auto& [index, change] : motion.change) shown += change * change / (noise_mm * noise_mm);
  return std::max(registered_to(motion), 1 / std::sqrt(1 + shown));
}

std::vector<NuisanceRow> motion_rows(const Layout& layout, const Standard& standard,
                                     const std::vector<SceneMotion>& motions) {
  std::vector<NuisanceRow> rows(motions.size());
  parallel_for(static_cast<int>(motions.size()), [&](int m) {
    StatVector raw(layout.size, 0.f);
    for (const auto& [index, value] : motions[m].change) raw[index] = value;
    rows[m] = {standard.difference(raw), motions[m].capture, motions[m].stated};
  });
  return rows;
}

std::vector<Offset> offsets_of(const Layout& layout, const std::vector<SceneMotion>& motions,
                               const std::vector<double>& values, const std::vector<Offset>& start) {
  std::vector<Offset> offsets = start;
  offsets.resize(layout.captures);
  for (std::size_t m = 0; m < motions.size(); ++m)
    for (int c = 0; c < layout.captures; ++c) {
      if (motions[m].capture >= 0 && motions[m].capture != c) continue;
      const double old = get(offsets[c], motions[m].element);
      const double limit = std::max(4 * motions[m].sigma, largest_motion[motions[m].element]);
      set(offsets[c], motions[m].element, std::clamp(old + values[m] * motions[m].sigma, -limit, limit));
    }
  return offsets;
}

std::vector<double> values_of(const std::vector<SceneMotion>& motions, const std::vector<Offset>& offsets) {
  std::vector<double> values(motions.size(), 0);
  if (offsets.empty()) return values;
  for (std::size_t m = 0; m < motions.size(); ++m)
    values[m] = get(offsets[std::max(0, motions[m].capture)], motions[m].element) / motions[m].sigma;
  return values;
}

StatVector shift_of(const Layout& layout, const std::vector<SceneMotion>& motions, const std::vector<double>& values) {
  StatVector shift(layout.size, 0.f);
  for (std::size_t m = 0; m < motions.size(); ++m)
    for (const auto& [index, value] : motions[m].change) shift[index] += static_cast<float>(values[m]) * value;
  return shift;
}

StatVector registered(const Layout& layout, const std::vector<SceneMotion>& motions, StatVector difference,
                      const std::vector<double>& simulated_at, const std::vector<double>& wanted_at) {
  std::vector<double> moved(motions.size());
  for (std::size_t m = 0; m < motions.size(); ++m) moved[m] = wanted_at[m] - simulated_at[m];
  const StatVector shift = shift_of(layout, motions, moved);
  for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= shift[i];
  return difference;
}

}  // namespace binrig
