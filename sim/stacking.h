// Parts fall into a bin and lie as they would: rigid bodies in Bullet.
//
// Frames: B = the bin, origin in the middle of the floor's upper face, z up through the opening; O = a part (its mesh's
// frame). Everything happens in B: a tilted bin is gravity that leans, a shaken one feels inertial forces, and every
// bin is a world of its own. Bullet works in millimetres (1 unit = 1 mm), at a step short enough and speeds clamped
// low enough that thin parts do not pass into each other: the drop is a means, not an experiment.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/pose.h"
#include "core/random.h"
#include "sim/convex_pieces.h"
#include "sim/mass_properties.h"

namespace binrig {

/// A kind of part as physics knows it.
struct Body {
  std::string name;
  std::vector<ConvexPiece> pieces;
  MassProperties mass;
  double friction = 0.4;               ///< Coulomb; a pair has the geometric mean of its two
  double restitution = 0.3;            ///< 0..1; likewise
  double rolling_resistance_mm = 0.2;  ///< lever arm of the normal force that resists rolling
};

/// An open box. Height 0 leaves a tray without walls.
struct BinBox {
  Vector3 inner_size_mm = Vector3(210, 160, 80);
  double wall_mm = 4;
  double friction = 0.4, restitution = 0.4;
};

/// How parts are laid out above the bin before they fall: an array of columns (x) by rows (y), in as many layers as
/// the parts need. 0 = chosen: as many columns and rows as fit, a spacing at which no two parts can touch.
struct DropLayout {
  int columns = 0, rows = 0;
  double spacing_mm = 0;  ///< between centres, in all three directions
  double height_mm = 10;  ///< of the lowest parts above the rim (or above the pile where that is higher)
  bool random_orientation = true;
  /// The bin is jolted to and fro while the parts come down (times gravity; 0 = not): what stands on a narrow edge by
  /// chance falls over, as in a bin that people carry.
  double jolt_gravities = 0.5;
};

/// Steady: every linear and angular velocity under its threshold at each of `checks` consecutive checks.
struct SteadyRule {
  double linear_mm_s = 5, angular_rad_s = 0.5;
  int checks = 5;
  double interval_s = 0.1;
  double time_limit_s = 20;  ///< simulated, from where the bin itself is quiet
};

struct StackingSettings {
  double gravity_mm_s2 = 9810;
  double step_s = 1.0 / 960;  ///< shortened up to ten times while parts are fast
  int iterations = 10;
  double most_linear_mm_s = 1000, most_angular_rad_s = 50;
  SteadyRule steady;
};

struct SettleReport {
  bool steady = false;  ///< false: the time limit ended it
  double simulated_s = 0, cpu_s = 0, wall_s = 0;
  int left_bin = 0;                ///< parts that fell out of the bin and were removed
  double most_penetration_mm = 0;  ///< of any two pieces at any step
};

struct PlacedPart {
  int id = 0;    ///< counts up from 0 in the order of dropping; never used again
  int kind = 0;  ///< index into the bodies
  Pose X_BO = Pose::Identity();
};

/// The world of one bin. Not thread-safe; different bins may run in different threads.
class Stacking {
 public:
  /// Throws Error listing everything that cannot work (no bodies, a body without pieces or mass, a bin smaller than a
  /// part, settings out of bounds). Draws come from `stream`: same stream and same calls, same poses bit for bit.
  Stacking(std::vector<Body> bodies, const BinBox& bin, const StackingSettings& settings, const RandomStream& stream);
  ~Stacking();

  /// Lays one part per element of `kinds` out above the bin, in random order, lets them fall and settles. Throws Error
  /// for no parts and for an array that does not fit above the bin.
  SettleReport drop(const std::vector<int>& kinds, const DropLayout& layout);

  /// Runs until steady, then freezes: velocities are zero and poses stay until the next call.
  SettleReport settle();

  /// Shakes the bin to and fro for a second (strength 0..1: up to 1.5 times gravity), then settles.
  SettleReport shake(double strength);

  /// Leans the bin by an angle about its x axis (slowly, so that the pile moves by its weight alone), then settles.
  /// Parts may slide out.
  SettleReport tilt(double angle_rad);

  /// The clamp: while it holds, no part moves against the bin, whatever the bin does.
  void clamp(bool hold);
  bool clamped() const;
  double tilt_rad() const;

  /// Takes a part out; the others wake in the next settle() (and wait for the clamp). False if there is no such part.
  bool remove(int id);
  void clear();

  /// In the order of ids.
  const std::vector<PlacedPart>& parts() const;
  const std::vector<Body>& bodies() const;
  const BinBox& bin() const;
  double weight_kg() const;
  int left_bin() const;  ///< since the beginning

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Radius (mm) about the centre of mass within which the whole part lies.
double bounding_radius_mm(const Body& body);

}  // namespace binrig
