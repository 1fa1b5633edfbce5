// Parts fall, come to rest and stay: the contract of sim/stacking.h on simple parts.
#include "sim/stacking.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/convex_hull.h"
#include "sim/part_models.h"
#include "sim/pile_quality.h"

namespace binrig {
namespace {

using testing::HasSubstr;

Body hull_body(const std::string& name, const Mesh& mesh, double density_kg_m3 = 7850) {
  Body body;
  body.name = name;
  ConvexPiece piece;
  for (const auto& v : mesh.vertices) piece.points.push_back(v.cast<double>());
  body.pieces = {piece};
  body.mass = mass_properties(mesh, density_kg_m3);
  return body;
}

Body box_body() { return hull_body("box", *box_mesh(Eigen::Vector3d(50, 30, 20), Surface{})); }
Body cylinder_body() { return hull_body("cylinder", *cylinder_mesh(10, 50, 48, Surface{})); }

/// Largest depth to which a corner of one part lies inside another, or below the floor, from the poses alone: it knows
/// nothing of the physics engine.
double deepest_corner_mm(const Stacking& stacking) {
  std::vector<ConvexHull> hulls;
  for (const Body& body : stacking.bodies()) hulls.push_back(convex_hull(body.pieces.front().points));
  double deepest = 0;
  for (const PlacedPart& a : stacking.parts()) {
    for (const Vector3& corner : hulls[a.kind].vertices) {
      const Vector3 p_B = a.X_BO * corner;
      deepest = std::max(deepest, -p_B.z());
      for (const PlacedPart& b : stacking.parts()) {
        if (a.id != b.id) deepest = std::max(deepest, -hulls[b.kind].outside_mm(b.X_BO.inverse() * p_B));
      }
    }
  }
  return deepest;
}

bool same_bytes(const std::vector<PlacedPart>& a, const std::vector<PlacedPart>& b) {
  if (a.size() != b.size()) return false;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i].id != b[i].id || a[i].kind != b[i].kind) return false;
    if (std::memcmp(a[i].X_BO.data(), b[i].X_BO.data(), 16 * sizeof(double)) != 0) return false;
  }
  return true;
}

std::string refusal(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Stacking, PilesComeToRestInsideTheBinWithoutPenetration) {
  for (const Body& body : {box_body(), cylinder_body()}) {
    for (std::uint64_t seed = 0; seed < 3; ++seed) {
      Stacking stacking({body}, BinBox{}, {}, RandomStream(seed));
      const SettleReport report = stacking.drop(std::vector<int>(9, 0), DropLayout{});
      EXPECT_TRUE(report.steady) << body.name << " seed " << seed;
      EXPECT_EQ(report.left_bin, 0);
      EXPECT_EQ(stacking.parts().size(), 9u);
      // Five checks of 100 ms at the very least.
      EXPECT_GE(report.simulated_s, 0.5 - 1e-9);
      EXPECT_LE(report.most_penetration_mm, 0.5);
      EXPECT_LE(deepest_corner_mm(stacking), 0.2) << body.name << " seed " << seed;
      for (const PlacedPart& part : stacking.parts()) {
        const Vector3 centre = part.X_BO.translation();
        EXPECT_LT(std::abs(centre.x()), 105);
        EXPECT_LT(std::abs(centre.y()), 80);
        EXPECT_GT(centre.z(), 0);
      }
    }
  }
}

Body part_body(const std::string& name) {
  const auto mesh = part_model(name).mesh;
  Body body;
  body.name = name;
  body.pieces = cached_convex_pieces(*mesh).pieces;
  body.mass = mass_properties(*mesh, 7850);
  return body;
}

TEST(Stacking, EveryPartLiesAsARealOneWould) {
  std::vector<Body> all;
  for (const std::string& name : part_names()) {
    all.push_back(part_body(name));
    Stacking stacking({all.back()}, BinBox{}, {}, RandomStream(11));
    const SettleReport report = stacking.drop(std::vector<int>(12, 0), DropLayout{});
    const PileQuality quality = pile_quality(stacking);
    EXPECT_TRUE(report.steady) << name;
    EXPECT_EQ(report.left_bin, 0) << name;
    EXPECT_LE(report.most_penetration_mm, 0.5) << name;
    EXPECT_LE(quality.most_penetration_mm, 0.2) << name;
    EXPECT_LE(quality.most_hover_mm, 0.5) << name;
    EXPECT_EQ(quality.interlocked, 0) << name;
  }
  Stacking mixed(all, BinBox{}, {}, RandomStream(12));
  EXPECT_TRUE(mixed.drop({0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5}, DropLayout{}).steady);
  EXPECT_LE(pile_quality(mixed).most_penetration_mm, 0.2);
  EXPECT_LE(pile_quality(mixed).most_hover_mm, 0.5);
}

TEST(PileQuality, SeesWhatIsWrongWithAPile) {
  const Body box = part_body("box"), bracket = part_body("bracket");
  const auto at = [](int id, int kind, const Vector3& t) {
    return PlacedPart{id, kind, Pose(Eigen::Translation3d(t))};
  };
  // 20 mm high: one lies on the floor, one hovers 3 mm above it, one sinks 1 mm into the floor beside them.
  const PileQuality q =
      pile_quality({box}, BinBox{}, {at(0, 0, {0, 0, 10}), at(1, 0, {0, 0, 33}), at(2, 0, {60, 0, 9})});
  EXPECT_EQ(q.hovering, 1);
  EXPECT_NEAR(q.most_hover_mm, 3, 0.01);
  EXPECT_NEAR(q.most_penetration_mm, 1, 0.05);
  EXPECT_EQ(q.interlocked, 0);
  // A box 1 mm inside another comes free; one in the middle of a larger one does not by any small motion.
  const PileQuality shallow = pile_quality({box}, BinBox{}, {at(0, 0, {0, 0, 10}), at(1, 0, {0, 0, 29})});
  EXPECT_NEAR(shallow.most_penetration_mm, 1, 0.05);
  EXPECT_EQ(shallow.interlocked, 0);
  const Body block = hull_body("block", *box_mesh(Eigen::Vector3d(80, 80, 80), Surface{}));
  EXPECT_EQ(pile_quality({block, box}, BinBox{}, {at(0, 0, {0, 0, 40}), at(1, 1, {0, 0, 40})}).interlocked, 1);
  EXPECT_EQ(pile_quality({bracket}, BinBox{}, {}).most_hover_mm, 0);
}

TEST(Stacking, ABoxLiesFlatOnTheFloor) {
  Stacking stacking({box_body()}, BinBox{}, {}, RandomStream(7));
  ASSERT_TRUE(stacking.drop({0}, DropLayout{}).steady);
  // One of the axes of the box is vertical and its half side is the height of the centre; 0.1 mm covers the margin of
  // 0.05 mm twice, and the tilt belongs to that over 20 mm, the shortest side.
  const Pose& X = stacking.parts().front().X_BO;
  int axis = 0;
  X.linear().row(2).cwiseAbs().maxCoeff(&axis);
  EXPECT_NEAR(std::abs(X.linear()(2, axis)), 1, 1e-4);
  EXPECT_NEAR(X.translation().z(), Vector3(25, 15, 10)[axis], 0.1);
}

TEST(Stacking, SameSeedSamePosesBitForBit) {
  const std::vector<Body> bodies{box_body(), cylinder_body()};
  const std::vector<int> kinds{0, 1, 0, 1, 0, 1, 0, 1};
  const auto run = [&](std::uint64_t seed) {
    Stacking stacking(bodies, BinBox{}, {}, RandomStream(seed));
    stacking.drop(kinds, DropLayout{});
    stacking.remove(3);
    stacking.settle();
    stacking.shake(0.5);
    return stacking.parts();
  };
  const auto first = run(1);
  EXPECT_TRUE(same_bytes(first, run(1)));
  EXPECT_FALSE(same_bytes(first, run(2)));
}

TEST(Stacking, FrozenBetweenCallsAndSteadyByTheRule) {
  StackingSettings settings;
  Stacking stacking({cylinder_body()}, BinBox{}, settings, RandomStream(3));
  ASSERT_TRUE(stacking.drop(std::vector<int>(12, 0), DropLayout{}).steady);
  const auto before = stacking.parts();
  EXPECT_TRUE(same_bytes(before, stacking.parts()));
  // Steady at 5 mm/s and 0.5 rad/s: within the next settle of 0.5 s nothing may fall, only creep at such speeds.
  const SettleReport again = stacking.settle();
  EXPECT_TRUE(again.steady);
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_LT(distance_between_mm(before[i].X_BO, stacking.parts()[i].X_BO),
              settings.steady.linear_mm_s * again.simulated_s + 0.5);
  }
}

TEST(Stacking, TheTimeLimitIsReported) {
  StackingSettings settings;
  settings.steady.time_limit_s = 0.2;  // less than five checks take
  Stacking stacking({box_body()}, BinBox{}, settings, RandomStream(1));
  DropLayout still;
  still.jolt_gravities = 0;  // the limit counts from where the bin is quiet
  const SettleReport report = stacking.drop({0, 0, 0}, still);
  EXPECT_FALSE(report.steady);
  EXPECT_NEAR(report.simulated_s, 0.2, settings.step_s * 2);
}

TEST(Stacking, TakingThePartBelowWakesTheOneAbove) {
  // Two boxes dropped flat, one on the other, in a bin that is hardly wider than they are.
  BinBox narrow;
  narrow.inner_size_mm = Vector3(60, 40, 120);
  DropLayout flat;
  flat.columns = flat.rows = 1;
  flat.random_orientation = false;
  flat.jolt_gravities = 0;
  Stacking stacking({box_body()}, narrow, {}, RandomStream(5));
  ASSERT_TRUE(stacking.drop({0, 0}, flat).steady);
  ASSERT_EQ(stacking.parts().size(), 2u);
  const bool first_below = stacking.parts()[0].X_BO.translation().z() < stacking.parts()[1].X_BO.translation().z();
  const int below = first_below ? 0 : 1;
  const double before = stacking.parts()[1 - below].X_BO.translation().z();
  EXPECT_TRUE(stacking.remove(stacking.parts()[below].id));
  EXPECT_FALSE(stacking.remove(12345));
  EXPECT_DOUBLE_EQ(stacking.parts().front().X_BO.translation().z(), before);
  EXPECT_TRUE(stacking.settle().steady);
  EXPECT_NEAR(stacking.parts().front().X_BO.translation().z(), before - 20, 1.0);
}

TEST(Stacking, CountAndWeightAreConserved) {
  // A tray without walls, a high drop: some parts roll off, and every one is accounted for.
  BinBox tray;
  tray.inner_size_mm = Vector3(120, 120, 0);
  Stacking stacking({cylinder_body(), box_body()}, tray, {}, RandomStream(2));
  int left = 0;
  left += stacking.drop({0, 0, 0, 0, 1, 1, 0, 0, 0, 0}, DropLayout{}).left_bin;
  left += stacking.shake(1).left_bin;
  EXPECT_GT(left, 0);
  EXPECT_EQ(stacking.left_bin(), left);
  EXPECT_EQ(stacking.parts().size() + static_cast<std::size_t>(left), 10u);
  double sum = 0;
  for (const PlacedPart& part : stacking.parts()) sum += stacking.bodies()[part.kind].mass.mass_kg;
  EXPECT_DOUBLE_EQ(stacking.weight_kg(), sum);
}

TEST(Stacking, TiltMovesThePileByItsWeight) {
  Stacking stacking({hull_body("cylinder", *cylinder_mesh(10, 50, 48, Surface{}))}, BinBox{}, {}, RandomStream(4));
  stacking.drop(std::vector<int>(6, 0), DropLayout{});
  const auto mean_y = [&] {
    double sum = 0;
    for (const PlacedPart& part : stacking.parts()) sum += part.X_BO.translation().y();
    return sum / static_cast<double>(stacking.parts().size());
  };
  const double before = mean_y();
  stacking.tilt(0.6);  // beyond the angle of friction, atan 0.4 = 0.38
  EXPECT_DOUBLE_EQ(stacking.tilt_rad(), 0.6);
  EXPECT_LT(mean_y(), before - 20);  // turned about x by a positive angle, -y is downhill
}

TEST(Stacking, RefusesWhatCannotWorkAndSaysEverything) {
  BinBox small;
  small.inner_size_mm = Vector3(40, 25, 80);
  Body hollow = box_body();
  hollow.name = "hollow";
  hollow.mass.mass_kg = 0;
  StackingSettings settings;
  settings.step_s = 0;
  const std::string all = refusal([&] { Stacking stacking({box_body(), hollow}, small, settings, RandomStream(1)); });
  EXPECT_THAT(all, HasSubstr("part box"));
  EXPECT_THAT(all, HasSubstr("is larger than the bin"));
  EXPECT_THAT(all, HasSubstr("part hollow: mass"));
  EXPECT_THAT(all, HasSubstr("step"));

  EXPECT_THAT(refusal([] { Stacking stacking({}, BinBox{}, {}, RandomStream(1)); }), HasSubstr("nothing to stack"));
  Stacking stacking({box_body()}, BinBox{}, {}, RandomStream(1));
  EXPECT_THAT(refusal([&] { stacking.drop({}, DropLayout{}); }), HasSubstr("nothing to drop"));
  DropLayout wide;
  wide.columns = 9;
  EXPECT_THAT(refusal([&] { stacking.drop({0}, wide); }), HasSubstr("wider than the bin"));
  EXPECT_THAT(refusal([&] { stacking.shake(2); }), HasSubstr("0 .. 1"));
  EXPECT_THAT(refusal([&] { stacking.tilt(3); }), HasSubstr("out of bounds"));
}

}  // namespace
}  // namespace binrig
