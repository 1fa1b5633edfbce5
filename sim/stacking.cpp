#include "sim/stacking.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <numbers>

#include <BulletCollision/CollisionShapes/btMultiSphereShape.h>
#include <LinearMath/btConvexHullComputer.h>
#include <btBulletDynamicsCommon.h>
#include <fmt/format.h>
#include <Eigen/Eigenvalues>

namespace binrig {
namespace {

// Pieces are shrunk by the margin that Bullet adds again around them, so that they touch where the part's faces do.
constexpr double margin_mm = 0.05;
// Contacts deeper than these take the solver more rounds.
constexpr double hard_depth_mm = 0.12, hardest_depth_mm = 0.3;
constexpr int hard_work = 4, hardest_work = 25;
constexpr double tilt_rate_rad_s = 0.5, steepest_tilt_rad = 1.5;
constexpr double shake_s = 1.0, shake_hz = 5, shake_gravities = 1.5;
constexpr double most_travel_mm = 0.3;
constexpr int most_substeps = 10;
// Parts poured by hand come drifting and turning; without that, too many stay standing on an edge.
constexpr double drift_mm_s = 150, spin_rad_s = 6;
constexpr double jolt_s = 0.3, jolt_hz = 6, turn_rad_s = 9;
// Slower impacts do not bounce, or a pile would hum on for ever.
constexpr double bounce_threshold_mm_s = 50;
// Velocities are looked at over this time.
constexpr double look_interval_s = 0.01;
// How often parts that left are looked for.
constexpr double escape_interval_s = 1.0 / 30;

btVector3 to_bullet(const Vector3& v) { return btVector3(btScalar(v.x()), btScalar(v.y()), btScalar(v.z())); }

btTransform to_bullet(const Pose& X) {
  const Eigen::Quaterniond q(X.linear());
  return btTransform(btQuaternion(btScalar(q.x()), btScalar(q.y()), btScalar(q.z()), btScalar(q.w())),
                     to_bullet(X.translation()));
}

Pose to_pose(const btTransform& transform) {
  const btQuaternion q = transform.getRotation();
  Pose X = Pose::Identity();
  X.linear() = Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()).normalized().toRotationMatrix();
  const btVector3& t = transform.getOrigin();
  X.translation() = Vector3(t.x(), t.y(), t.z());
  return X;
}

double thread_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::unique_ptr<btCollisionShape> piece_shape(const ConvexPiece& piece, const Pose& X_MO) {
  if (piece.points.size() == 1) {
    // Not btSphereShape: Bullet's own pair of spheres has no contact ahead of touch, so that a ball at rest falls for a
    // step now and then and a pile of them never counts as still.
    const btVector3 centre(0, 0, 0);
    const auto radius = btScalar(piece.radius_mm);
    return std::make_unique<btMultiSphereShape>(&centre, &radius, 1);
  }
  std::vector<Vector3> points;
  for (const Vector3& p : piece.points) points.push_back(X_MO * p);
  btConvexHullComputer hull;
  const double shrink = std::max(0.0, margin_mm - piece.radius_mm);
  // At most half of what the thinnest piece has.
  hull.compute(points.front().data(), static_cast<int>(sizeof(Vector3)), static_cast<int>(points.size()),
               btScalar(shrink), btScalar(0.5));
  auto shape = std::make_unique<btConvexHullShape>();
  for (int i = 0; i < hull.vertices.size(); ++i) shape->addPoint(hull.vertices[i], false);
  shape->recalcLocalAabb();
  shape->setMargin(btScalar(std::max(margin_mm, piece.radius_mm)));
  return shape;
}

/// Bullet stops what comes together fast at the first touch, a step ahead of it, and the little speed that is left
/// after that is what bounces. Here the contacts that would close within this step count as closed, so that the whole
/// speed bounces.
class BouncingWorld : public btDiscreteDynamicsWorld {
 public:
  using btDiscreteDynamicsWorld::btDiscreteDynamicsWorld;

 protected:
  void solveConstraints(btContactSolverInfo& info) override {
    for (int i = 0; i < getDispatcher()->getNumManifolds(); ++i) {
      btPersistentManifold& manifold = *getDispatcher()->getManifoldByIndexInternal(i);
      const btRigidBody *a = btRigidBody::upcast(manifold.getBody0()), *b = btRigidBody::upcast(manifold.getBody1());
      for (int k = 0; k < manifold.getNumContacts(); ++k) {
        btManifoldPoint& point = manifold.getContactPoint(k);
        if (point.getDistance() <= 0) continue;
        btVector3 v(0, 0, 0);
        if (a) v += a->getVelocityInLocalPoint(point.getPositionWorldOnA() - a->getCenterOfMassPosition());
        if (b) v -= b->getVelocityInLocalPoint(point.getPositionWorldOnB() - b->getCenterOfMassPosition());
        const btScalar closing = -v.dot(point.m_normalWorldOnB);
        if (closing > info.m_restitutionVelocityThreshold && closing * info.m_timeStep > point.getDistance()) {
          point.setDistance(0);
        }
      }
    }
    btDiscreteDynamicsWorld::solveConstraints(info);
  }
};

/// A kind of part ready for Bullet: M is the frame of its principal axes about its centre of mass.
struct Kind {
  std::vector<std::unique_ptr<btCollisionShape>> pieces;
  std::unique_ptr<btCompoundShape> shape;
  Pose X_OM = Pose::Identity();
  btVector3 inertia;
  double radius_mm = 0;
};

Kind make_kind(const Body& body) {
  Kind kind;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(body.mass.inertia_kg_mm2);
  kind.X_OM.linear() = axes.eigenvectors();
  if (kind.X_OM.linear().determinant() < 0) kind.X_OM.linear().col(0) *= -1;
  kind.X_OM.translation() = body.mass.centre_mm;
  kind.inertia = to_bullet(axes.eigenvalues());
  const Pose X_MO = kind.X_OM.inverse();
  kind.shape = std::make_unique<btCompoundShape>(true, static_cast<int>(body.pieces.size()));
  for (const ConvexPiece& piece : body.pieces) {
    btTransform X_MP = btTransform::getIdentity();
    if (piece.points.size() == 1) X_MP.setOrigin(to_bullet(X_MO * piece.points.front()));
    kind.pieces.push_back(piece_shape(piece, X_MO));
    kind.shape->addChildShape(X_MP, kind.pieces.back().get());
  }
  kind.shape->setMargin(btScalar(margin_mm));
  kind.radius_mm = bounding_radius_mm(body);
  return kind;
}

/// Sides of the box along the axes of O around a part, ascending.
Vector3 sorted_extent(const Body& body) {
  Vector3 low = Vector3::Constant(1e30), high = -low;
  for (const ConvexPiece& piece : body.pieces) {
    for (const Vector3& p : piece.points) {
      low = low.cwiseMin(p - Vector3::Constant(piece.radius_mm));
      high = high.cwiseMax(p + Vector3::Constant(piece.radius_mm));
    }
  }
  Vector3 size = high - low;
  std::sort(size.data(), size.data() + 3);
  return size;
}

void check_bodies(const std::vector<Body>& bodies, const BinBox& bin, Violations& violations) {
  if (bodies.empty()) violations.add("", "parts", "are missing: nothing to stack");
  const double shorter = std::min(bin.inner_size_mm.x(), bin.inner_size_mm.y()),
               longer = std::max(bin.inner_size_mm.x(), bin.inner_size_mm.y());
  for (const Body& body : bodies) {
    const std::string where = "part " + body.name;
    bool whole = !body.pieces.empty();
    for (const ConvexPiece& piece : body.pieces) {
      whole = whole && (piece.points.size() >= 4 || (piece.points.size() == 1 && piece.radius_mm > 0));
    }
    if (!whole) violations.add(where, "pieces", "enclose no volume");
    Eigen::Vector3d inertia = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(body.mass.inertia_kg_mm2).eigenvalues();
    if (!(body.mass.mass_kg > 0) || !(inertia.minCoeff() > 0)) {
      violations.add({where, "mass", number_text(body.mass.mass_kg), "kg", "", "and inertia must be positive"});
    }
    if (!whole) continue;
    const Vector3 size = sorted_extent(body);
    if (size[2] > longer || size[1] > shorter) {
      violations.add({where, "", fmt::format("{:.4g} x {:.4g} x {:.4g}", size[2], size[1], size[0]), "mm",
                      fmt::format("{:.4g} x {:.4g}", longer, shorter), "is larger than the bin"});
    }
  }
}

void check_settings(const StackingSettings& settings, const BinBox& bin, Violations& violations) {
  const auto positive = [&](const char* key, double value, const char* unit) {
    if (!(value > 0) || !std::isfinite(value))
      violations.add({"", key, number_text(value), unit, "", "must be positive"});
  };
  positive("step", settings.step_s, "s");
  positive("iterations", settings.iterations, "");
  positive("gravity", settings.gravity_mm_s2, "mm/s^2");
  positive("most_linear", settings.most_linear_mm_s, "mm/s");
  positive("most_angular", settings.most_angular_rad_s, "rad/s");
  positive("steady.linear", settings.steady.linear_mm_s, "mm/s");
  positive("steady.angular", settings.steady.angular_rad_s, "rad/s");
  positive("steady.checks", settings.steady.checks, "");
  positive("steady.interval", settings.steady.interval_s, "s");
  positive("steady.time_limit", settings.steady.time_limit_s, "s");
  positive("bin.size.x", bin.inner_size_mm.x(), "mm");
  positive("bin.size.y", bin.inner_size_mm.y(), "mm");
  positive("bin.wall", bin.wall_mm, "mm");
  if (!(bin.inner_size_mm.z() >= 0)) violations.add("", "bin.size.z", "must not be negative");
  // Bullet turns speed into motion once a step: a clamp beyond this lets parts pass through a wall.
  if (settings.most_linear_mm_s * settings.step_s > 2) {
    violations.add({"", "most_linear", number_text(settings.most_linear_mm_s), "mm/s",
                    "up to " + number_text(2 / settings.step_s), "moves parts more than 2 mm a step"});
  }
}

}  // namespace

double bounding_radius_mm(const Body& body) {
  double radius = 0;
  for (const ConvexPiece& piece : body.pieces) {
    for (const Vector3& p : piece.points) {
      radius = std::max(radius, (p - body.mass.centre_mm).norm() + piece.radius_mm);
    }
  }
  return radius;
}

struct Stacking::Impl {
  std::vector<Body> bodies;
  BinBox bin;
  StackingSettings settings;
  RandomStream stream;
  std::vector<Kind> kinds;

  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  btDbvtBroadphase broadphase;
  btSequentialImpulseConstraintSolver solver;
  BouncingWorld world{&dispatcher, &broadphase, &solver, &configuration};

  std::vector<std::unique_ptr<btBoxShape>> bin_shapes;
  std::vector<std::unique_ptr<btCollisionObject>> bin_objects;
  std::vector<PlacedPart> parts;  // in the order of `moving`
  std::vector<std::unique_ptr<btRigidBody>> moving;
  int next_id = 0, drops = 0, shakes = 0, left_bin = 0;
  double tilt_rad = 0;
  double depth_mm = 0;  ///< deepest contact of the last step
  bool clamped = false;
  SettleReport report;

  Impl(std::vector<Body> bodies_, const BinBox& bin_, const StackingSettings& settings_, const RandomStream& stream_)
      : bodies(std::move(bodies_)), bin(bin_), settings(settings_), stream(stream_) {}

  ~Impl() {
    for (auto& body : moving) world.removeRigidBody(body.get());
    for (auto& object : bin_objects) world.removeCollisionObject(object.get());
  }

  void build() {
    for (const Body& body : bodies) kinds.push_back(make_kind(body));
    btContactSolverInfo& info = world.getSolverInfo();
    info.m_numIterations = settings.iterations;
    info.m_splitImpulse = true;
    info.m_splitImpulsePenetrationThreshold = btScalar(-0.02);
    info.m_restitutionVelocityThreshold = btScalar(bounce_threshold_mm_s);
    const double w = bin.inner_size_mm.x(), l = bin.inner_size_mm.y(), h = bin.inner_size_mm.z(), t = bin.wall_mm;
    add_wall(Vector3(w + 2 * t, l + 2 * t, t), Vector3(0, 0, -t / 2));
    if (h > 0) {
      for (double side : {-1.0, 1.0}) {
        add_wall(Vector3(t, l + 2 * t, h), Vector3(side * (w + t) / 2, 0, h / 2));
        add_wall(Vector3(w, t, h), Vector3(0, side * (l + t) / 2, h / 2));
      }
    }
    lean();
  }

  void add_wall(const Vector3& size_mm, const Vector3& centre_mm) {
    bin_shapes.push_back(std::make_unique<btBoxShape>(to_bullet(Vector3(size_mm / 2))));
    bin_shapes.back()->setMargin(btScalar(margin_mm));
    auto object = std::make_unique<btCollisionObject>();
    object->setCollisionShape(bin_shapes.back().get());
    Pose X = Pose::Identity();
    X.translation() = centre_mm;
    object->setWorldTransform(to_bullet(X));
    set_surface(*object, bin.friction, bin.restitution, 0);
    world.addCollisionObject(object.get(), btBroadphaseProxy::StaticFilter,
                             btBroadphaseProxy::AllFilter ^ btBroadphaseProxy::StaticFilter);
    bin_objects.push_back(std::move(object));
  }

  // Bullet multiplies the two values of a pair; roots make that their geometric mean. Its rolling resistance of a pair
  // is r1 f2 + r2 f1; with the rolling resistance set on parts only, dividing by a friction near 0.5 keeps its size.
  static void set_surface(btCollisionObject& object, double friction, double restitution, double rolling_mm) {
    object.setFriction(btScalar(std::sqrt(friction)));
    object.setRestitution(btScalar(std::sqrt(restitution)));
    object.setRollingFriction(btScalar(rolling_mm));
    object.setSpinningFriction(btScalar(rolling_mm));
  }

  // Gravity and, while shaking, the inertial force of the bin's motion, in B.
  void lean(const Vector3& shaking_mm_s2 = Vector3::Zero()) {
    const Eigen::AngleAxisd R_BW(-tilt_rad, Vector3::UnitX());
    world.setGravity(to_bullet(Vector3(R_BW * Vector3(0, 0, -settings.gravity_mm_s2) + shaking_mm_s2)));
  }

  void add_part(int kind, const Pose& X_BO) {
    const Body& body = bodies[static_cast<std::size_t>(kind)];
    Kind& prepared = kinds[static_cast<std::size_t>(kind)];
    btRigidBody::btRigidBodyConstructionInfo info(btScalar(body.mass.mass_kg), nullptr, prepared.shape.get(),
                                                  prepared.inertia);
    info.m_startWorldTransform = to_bullet(X_BO * prepared.X_OM);
    info.m_linearDamping = btScalar(0.02);
    info.m_angularDamping = btScalar(0.1);
    auto rigid = std::make_unique<btRigidBody>(info);
    set_surface(*rigid, body.friction, body.restitution, body.rolling_resistance_mm);
    rigid->setActivationState(DISABLE_DEACTIVATION);
    world.addRigidBody(rigid.get());
    moving.push_back(std::move(rigid));
    parts.push_back({next_id++, kind, X_BO});
  }

  // A step, in parts so short that no point of a part moves further than `most_travel_mm` in one of them: what comes
  // together fast would otherwise be inside each other before Bullet sees the second of two points of contact.
  void step() {
    double fastest = 0;
    for (std::size_t i = 0; i < moving.size(); ++i) {
      fastest = std::max<double>(fastest, moving[i]->getLinearVelocity().length() +
                                              moving[i]->getAngularVelocity().length() *
                                                  kinds[static_cast<std::size_t>(parts[i].kind)].radius_mm);
    }
    const int substeps =
        std::clamp(static_cast<int>(std::ceil(fastest * settings.step_s / most_travel_mm)), 1, most_substeps);
    for (int i = 0; i < substeps; ++i) substep(settings.step_s / substeps);
    report.simulated_s += settings.step_s;
  }

  void substep(double seconds) {
    // A heavy part on a light one takes the solver more rounds to stop.
    const int work = depth_mm > hardest_depth_mm ? hardest_work : depth_mm > hard_depth_mm ? hard_work : 1;
    world.getSolverInfo().m_numIterations = settings.iterations * work;
    world.stepSimulation(btScalar(seconds), 0);
    depth_mm = 0;
    const auto linear = btScalar(settings.most_linear_mm_s), angular = btScalar(settings.most_angular_rad_s);
    for (auto& body : moving) {
      const btScalar v = body->getLinearVelocity().length(), w = body->getAngularVelocity().length();
      if (v > linear) body->setLinearVelocity(body->getLinearVelocity() * (linear / v));
      if (w > angular) body->setAngularVelocity(body->getAngularVelocity() * (angular / w));
    }
    for (int i = 0; i < dispatcher.getNumManifolds(); ++i) {
      const btPersistentManifold* manifold = dispatcher.getManifoldByIndexInternal(i);
      for (int k = 0; k < manifold->getNumContacts(); ++k) {
        depth_mm = std::max(depth_mm, -double(manifold->getContactPoint(k).getDistance()));
      }
    }
    report.most_penetration_mm = std::max(report.most_penetration_mm, depth_mm);
  }

  void remove_escaped() {
    const double x = bin.inner_size_mm.x() / 2 + bin.wall_mm, y = bin.inner_size_mm.y() / 2 + bin.wall_mm;
    for (std::size_t i = moving.size(); i-- > 0;) {
      const btVector3& p = moving[i]->getWorldTransform().getOrigin();
      if (std::abs(p.x()) <= x && std::abs(p.y()) <= y && p.z() > -bin.wall_mm) continue;
      erase(i);
      ++left_bin;
      ++report.left_bin;
    }
  }

  void erase(std::size_t i) {
    world.removeRigidBody(moving[i].get());
    moving.erase(moving.begin() + static_cast<std::ptrdiff_t>(i));
    parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(i));
  }

  // Until a moment after the highest part has come down.
  void jolt(double gravities) {
    double top = 0;
    for (auto& body : moving) top = std::max<double>(top, body->getWorldTransform().getOrigin().z());
    const double g = settings.gravity_mm_s2, clamp = settings.most_linear_mm_s;
    // Free fall up to the clamp, then at that speed.
    const double fast = clamp * clamp / (2 * g);
    const double fall_s = top < fast ? std::sqrt(2 * top / g) : clamp / g + (top - fast) / clamp;
    const double angle = 2 * std::numbers::pi * stream.child("jolt").uniform(static_cast<std::uint64_t>(drops));
    run_for(fall_s + jolt_s, [&](double t) {
      const double a = gravities * g * std::cos(2 * std::numbers::pi * jolt_hz * t), turn = angle + turn_rad_s * t;
      lean(Vector3(a * std::cos(turn), a * std::sin(turn), 0));
    });
    lean();
  }

  // Whether every part has moved more slowly than the thresholds since it was at `before`. Bullet's own velocity at one
  // instant holds what a part gained in a single step of free fall (10 mm/s) where a contact was just missing.
  bool slow_since(const std::vector<btTransform>& before, double seconds) const {
    for (std::size_t i = 0; i < moving.size(); ++i) {
      const btTransform& now = moving[i]->getWorldTransform();
      const double way_mm = (now.getOrigin() - before[i].getOrigin()).length();
      const double turn_rad = now.getRotation().angleShortestPath(before[i].getRotation());
      if (way_mm >= settings.steady.linear_mm_s * seconds || turn_rad >= settings.steady.angular_rad_s * seconds) {
        return false;
      }
    }
    return true;
  }

  // Runs `before_step(t)` and a step until `seconds` have passed.
  template <class F>
  void run_for(double seconds, F&& before_step) {
    const int steps = static_cast<int>(std::ceil(seconds / settings.step_s));
    const int every = std::max(1, static_cast<int>(escape_interval_s / settings.step_s));
    for (int i = 0; i < steps; ++i) {
      before_step(i * settings.step_s);
      step();
      if (i % every == every - 1 || i + 1 == steps) remove_escaped();
    }
  }

  void run_until_steady() {
    const SteadyRule& rule = settings.steady;
    const double look_s = std::min(look_interval_s, rule.interval_s / 2);
    int calm = 0;
    const double begin_s = report.simulated_s;
    while (calm < rule.checks && report.simulated_s - begin_s < rule.time_limit_s - settings.step_s / 2) {
      run_for(rule.interval_s - look_s, [](double) {});
      std::vector<btTransform> before;
      for (const auto& body : moving) before.push_back(body->getWorldTransform());
      const double from_s = report.simulated_s;
      run_for(look_s, [](double) {});
      // A part that left in between is movement, too.
      const bool slow = before.size() == moving.size() && slow_since(before, report.simulated_s - from_s);
      calm = slow ? calm + 1 : 0;
    }
    report.steady = calm >= rule.checks;
  }

  template <class F>
  SettleReport timed(F&& work) {
    report = SettleReport{};
    const double cpu_s = thread_cpu_s();
    const auto wall = std::chrono::steady_clock::now();
    if (clamped) {
      report.steady = true;
      return report;
    }
    work();
    run_until_steady();
    for (std::size_t i = 0; i < moving.size(); ++i) {
      moving[i]->setLinearVelocity(btVector3(0, 0, 0));
      moving[i]->setAngularVelocity(btVector3(0, 0, 0));
      moving[i]->clearForces();
      parts[i].X_BO =
          to_pose(moving[i]->getWorldTransform()) * kinds[static_cast<std::size_t>(parts[i].kind)].X_OM.inverse();
    }
    report.cpu_s = thread_cpu_s() - cpu_s;
    report.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall).count();
    return report;
  }

  void lay_out(std::vector<int> dropped, const DropLayout& layout);
};

void Stacking::Impl::lay_out(std::vector<int> dropped, const DropLayout& layout) {
  Violations violations;
  if (dropped.empty()) violations.add("", "count", "is 0: there is nothing to drop");
  double radius = 0;
  for (int kind : dropped) {
    if (kind < 0 || kind >= static_cast<int>(bodies.size())) throw Error("a part of a kind that the bin does not know");
    radius = std::max(radius, kinds[static_cast<std::size_t>(kind)].radius_mm);
  }
  const double w = bin.inner_size_mm.x(), l = bin.inner_size_mm.y();
  const double spacing = layout.spacing_mm > 0 ? layout.spacing_mm : 2 * radius + 1;
  const int columns = layout.columns > 0 ? layout.columns : std::max(1, static_cast<int>(w / spacing));
  const int rows = layout.rows > 0 ? layout.rows : std::max(1, static_cast<int>(l / spacing));
  // One part in a narrow bin may begin over the rim: it falls in as it turns.
  const auto room = [&](double side, int count) { return side - (count - 1) * spacing - (count > 1 ? 2 * radius : 0); };
  const double room_x = room(w, columns), room_y = room(l, rows);
  if (room_x < 0 || room_y < 0) {
    violations.add({"", "layout", fmt::format("{} x {} parts, {:.4g} mm apart", columns, rows, spacing), "",
                    fmt::format("{:.4g} x {:.4g} mm", w, l), "is an array wider than the bin"});
  }
  if (spacing < 2 * radius && layout.random_orientation) {
    violations.add({"", "layout.spacing", number_text(spacing), "mm", "from " + number_text(std::ceil(2 * radius)),
                    "lets parts overlap that turn at random"});
  }
  violations.throw_if_any("cannot lay out the parts");

  const RandomStream draws = stream.child("drop").child(static_cast<std::uint64_t>(drops++));
  std::uint64_t index = 0;
  for (std::size_t i = dropped.size(); i > 1; --i) {
    std::swap(dropped[i - 1], dropped[static_cast<std::size_t>(draws.uniform(index++) * static_cast<double>(i))]);
  }
  double base = bin.inner_size_mm.z();
  for (std::size_t i = 0; i < moving.size(); ++i) {
    const double r = kinds[static_cast<std::size_t>(parts[i].kind)].radius_mm;
    base = std::max(base, double(moving[i]->getWorldTransform().getOrigin().z()) + r);
  }
  // A layer as a whole lies anywhere in the room that it has; inside it parts keep their places.
  Vector3 shift = Vector3::Zero();
  for (std::size_t i = 0; i < dropped.size(); ++i) {
    const int slot = static_cast<int>(i) % (columns * rows), layer = static_cast<int>(i) / (columns * rows);
    if (slot == 0) {
      const double free_x = columns > 1 ? room_x : std::max(0.0, w - 2 * radius),
                   free_y = rows > 1 ? room_y : std::max(0.0, l - 2 * radius);
      shift = Vector3((draws.uniform(index) - 0.5) * free_x, (draws.uniform(index + 1) - 0.5) * free_y, 0);
      index += 2;
    }
    const Kind& kind = kinds[static_cast<std::size_t>(dropped[i])];
    Pose X_BM = Pose::Identity();
    X_BM.translation() =
        shift + Vector3((slot % columns - (columns - 1) / 2.0) * spacing, (slot / columns - (rows - 1) / 2.0) * spacing,
                        base + layout.height_mm + radius + layer * spacing);
    X_BM.linear() = kind.X_OM.linear();
    if (layout.random_orientation) {
      // Uniform over rotations (Shoemake, Graphics Gems III).
      const double u = draws.uniform(index), a = 2 * std::numbers::pi * draws.uniform(index + 1),
                   b = 2 * std::numbers::pi * draws.uniform(index + 2);
      index += 3;
      X_BM.linear() = Eigen::Quaterniond(std::sqrt(u) * std::cos(b), std::sqrt(1 - u) * std::sin(a),
                                         std::sqrt(1 - u) * std::cos(a), std::sqrt(u) * std::sin(b))
                          .toRotationMatrix();
    }
    add_part(dropped[i], X_BM * kind.X_OM.inverse());
    if (layout.random_orientation) {
      const auto draw = [&](double most) { return btScalar((2 * draws.uniform(index++) - 1) * most); };
      const btScalar vx = draw(drift_mm_s), vy = draw(drift_mm_s);
      const btScalar wx = draw(spin_rad_s), wy = draw(spin_rad_s), wz = draw(spin_rad_s);
      moving.back()->setLinearVelocity(btVector3(vx, vy, 0));
      moving.back()->setAngularVelocity(btVector3(wx, wy, wz));
    }
  }
}

Stacking::Stacking(std::vector<Body> bodies, const BinBox& bin, const StackingSettings& settings,
                   const RandomStream& stream) {
  Violations violations;
  check_settings(settings, bin, violations);
  check_bodies(bodies, bin, violations);
  violations.throw_if_any("cannot stack the parts");
  impl_ = std::make_unique<Impl>(std::move(bodies), bin, settings, stream);
  impl_->build();
}

Stacking::~Stacking() = default;

SettleReport Stacking::drop(const std::vector<int>& kinds, const DropLayout& layout) {
  if (impl_->clamped) throw Error("cannot drop parts into a clamped bin: release the clamp first");
  return impl_->timed([&] {
    impl_->lay_out(kinds, layout);
    if (layout.jolt_gravities > 0) impl_->jolt(layout.jolt_gravities);
  });
}

SettleReport Stacking::settle() {
  return impl_->timed([] {});
}

SettleReport Stacking::shake(double strength) {
  if (!(strength >= 0 && strength <= 1)) {
    throw Error("cannot shake the bin", {{"", "strength", number_text(strength), "", "0 .. 1", "is out of bounds"}});
  }
  const RandomStream draws = impl_->stream.child("shake").child(static_cast<std::uint64_t>(impl_->shakes++));
  const double direction = 2 * std::numbers::pi * draws.uniform(0);
  const double strongest = strength * shake_gravities * impl_->settings.gravity_mm_s2;
  return impl_->timed([&] {
    impl_->run_for(shake_s, [&](double t) {
      // The direction wanders round once, so that parts move both ways.
      const double angle = direction + 2 * std::numbers::pi * t / shake_s;
      // A cosine: the bin's speed, its integral, swings about zero, so that the pile does not drift to one side.
      const double a = strongest * std::cos(2 * std::numbers::pi * shake_hz * t);
      impl_->lean(Vector3(a * std::cos(angle), a * std::sin(angle), 0));
    });
    impl_->lean();
  });
}

SettleReport Stacking::tilt(double angle_rad) {
  if (!(std::abs(angle_rad) <= steepest_tilt_rad)) {
    throw Error("cannot tilt the bin",
                {{"", "tilt", number_text(angle_rad), "rad",
                  "-" + number_text(steepest_tilt_rad) + " .. " + number_text(steepest_tilt_rad), "is out of bounds"}});
  }
  const double from = impl_->tilt_rad, way = angle_rad - from;
  if (impl_->clamped) {
    impl_->tilt_rad = angle_rad;
    impl_->lean();
  }
  return impl_->timed([&] {
    const double seconds = std::abs(way) / tilt_rate_rad_s;
    impl_->run_for(seconds, [&](double t) {
      impl_->tilt_rad = from + way * t / seconds;
      impl_->lean();
    });
    impl_->tilt_rad = angle_rad;
    impl_->lean();
  });
}

double Stacking::tilt_rad() const { return impl_->tilt_rad; }

void Stacking::clamp(bool hold) { impl_->clamped = hold; }
bool Stacking::clamped() const { return impl_->clamped; }

bool Stacking::remove(int id) {
  for (std::size_t i = 0; i < impl_->parts.size(); ++i) {
    if (impl_->parts[i].id != id) continue;
    impl_->erase(i);
    return true;
  }
  return false;
}

void Stacking::clear() {
  while (!impl_->moving.empty()) impl_->erase(impl_->moving.size() - 1);
}

const std::vector<PlacedPart>& Stacking::parts() const { return impl_->parts; }
const std::vector<Body>& Stacking::bodies() const { return impl_->bodies; }
const BinBox& Stacking::bin() const { return impl_->bin; }
int Stacking::left_bin() const { return impl_->left_bin; }

double Stacking::weight_kg() const {
  double sum = 0;
  for (const PlacedPart& part : impl_->parts) sum += impl_->bodies[static_cast<std::size_t>(part.kind)].mass.mass_kg;
  return sum;
}

}  // namespace binrig
