// Where the targets really stood and what the lens really was: nuisances with priors, fitted and marginalised.
#pragma once

#include <vector>

#include "diagnose/metric.h"

namespace binrig {

/// How well poses and intrinsics are known; generous where the set does not say.
struct RegistrationPrior {
  double pose_mm = 2, pose_rad = 0.005;
  double focal_px = 2, cx_px = 0.5, cy_px = 0.5;
  bool poses_known = false, intrinsics_known = false;
};
RegistrationPrior registration_prior(const SetInfo& set, const Camera& camera);

/// First derivatives of the bias maps by poses (6 a capture, rotations first) and intrinsics, from perfect depth alone:
/// what the maps change by when one of them moves by one prior sigma. Masks and edges move, too, but by less than their
/// own scatter; they get it through random poses in the simulations that the spread is learned from.
/// Its change is taken from interior pixels in which depth follows it smoothly: where a step passes through a pixel,
/// nothing is said. Of a target that moves, from frames of its whole way.
struct SceneMotion {
  int capture = -1;                           ///< -1: an intrinsic, touches all
  int element = 0;                            ///< of Offset::pose, or 6, 7, 8 = focal length, cx, cy
  double sigma = 0;                           ///< one prior sigma
  bool stated = true;                         ///< NuisanceRow::stated
  std::vector<std::pair<int, float>> change;  ///< element of the vector, mm
};
std::vector<SceneMotion> scene_motions(const Experiment& experiment, const SensorModel& model,
                                       const RegistrationPrior& prior);

/// To how many prior sigmas a motion is registered, if depth shows it: those of 0.3 mm or 1 mrad (by judgement). Over
/// the 2 mm within which a target is said to stand at 200 mm its noise changes by more than chance makes of an image. 1
/// where what is said is good enough, and for intrinsics.
double registered_to(const SceneMotion& motion);
/// Standard deviation, in prior sigmas, of what registration leaves of a motion: that, or more where depth shows too
/// little of it (a plane within itself).
double left_open(const SceneMotion& motion);

/// The motions as rows of a metric under a standard.
std::vector<NuisanceRow> motion_rows(const Layout& layout, const Standard& standard,
                                     const std::vector<SceneMotion>& motions);
/// Offsets by capture of values in prior sigmas (order of the motions), added to `start` (empty = nominal). What
/// is no small motion (20 mrad, 5 mm, or 4 sigmas if these are more) is clipped.
std::vector<Offset> offsets_of(const Layout& layout, const std::vector<SceneMotion>& motions,
                               const std::vector<double>& values, const std::vector<Offset>& start);
/// The values, in prior sigmas, at which motions stand in offsets (empty = nominal).
std::vector<double> values_of(const std::vector<SceneMotion>& motions, const std::vector<Offset>& offsets);
/// What the bias maps move by for given values; 0 elsewhere.
StatVector shift_of(const Layout& layout, const std::vector<SceneMotion>& motions, const std::vector<double>& values);
/// Measured less simulated statistics with targets and lens moved on, in the bias maps, from where the simulations had
/// them to where the data want them; both in prior sigmas, the motions first.
StatVector registered(const Layout& layout, const std::vector<SceneMotion>& motions, StatVector difference,
                      const std::vector<double>& simulated_at, const std::vector<double>& wanted_at);

}  // namespace binrig
