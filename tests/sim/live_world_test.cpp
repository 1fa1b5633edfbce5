// What the bin is told, the world does; what the world does, the camera sees.
#include "sim/live_world.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "sim/renderer.h"
#include "sim/world_physics.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const char* const six_parts = R"(
name: six parts
parts:
  - {part: cylinder}
  - {part: box, mass: 0.1}
bins:
  - name: bin
    inner_size: [150, 120, 60]
    fill: {cylinder: 4, box: 2}
sensors:
  - pose: {from: [0, 0, 600], at: [0, 0, 0]}
    camera: {width: 96, height: 80, horizontal_fov_deg: 18}
)";

std::shared_ptr<LiveWorld> live(std::uint64_t seed = 1) {
  return std::make_shared<LiveWorld>(parse_world(six_parts, "six.yaml"), seed);
}

std::shared_ptr<const Channels> picture(const LiveWorld& world) {
  const auto now = world.now();
  static const auto renderer = make_renderer("embree");
  RenderRequest request;
  request.camera = *now->sensors[0].camera;
  request.wanted = Channel::depth | Channel::instance | Channel::rgb;
  return renderer->render(render_scene(*now, now->sensors[0].X_WC[0]), request);
}

bool same_depth(const Channels& a, const Channels& b) { return cv::norm(a.depth_mm, b.depth_mm, cv::NORM_INF) == 0; }

double most_moved_mm(const World& a, const World& b) {
  double moved = 0;
  for (std::size_t i = 0; i < std::min(a.objects.size(), b.objects.size()); ++i) {
    moved = std::max(moved, distance_between_mm(a.objects[i].X_WO, b.objects[i].X_WO));
  }
  return moved;
}

TEST(LiveWorld, DropsWhatItsBinsAreFilledWith) {
  const auto world = live();
  const auto now = world->now();
  ASSERT_EQ(now->objects.size(), 6u);
  EXPECT_TRUE(world->last_settle(0).steady);
  int cylinders = 0;
  for (const WorldObject& object : now->objects) cylinders += object.part == 0;
  EXPECT_EQ(cylinders, 4);
  // The same seed gives the same world, another scene another pile, and the first scene again the first pile.
  EXPECT_EQ(most_moved_mm(*now, *live()->now()), 0);
  world->begin_scene(1);
  EXPECT_GT(most_moved_mm(*now, *world->now()), 5);
  world->begin_scene(0);
  EXPECT_EQ(most_moved_mm(*now, *world->now()), 0);
  // Frozen until somebody acts.
  EXPECT_TRUE(same_depth(*picture(*world), *picture(*world)));
}

TEST(SimulatedBin, ShakingMovesThePileAndThePicture) {
  const auto world = live();
  const auto bin = make_simulated_bin(world);
  const auto before = world->now();
  const auto seen = picture(*world);
  bin->command({BinCommand::Kind::shake, 1});
  EXPECT_GT(most_moved_mm(*before, *world->now()), 2);
  EXPECT_FALSE(same_depth(*seen, *picture(*world)));
  EXPECT_EQ(bin->state().fault, 0);
  EXPECT_THROW(bin->command({BinCommand::Kind::shake, 3}), Error);
}

TEST(SimulatedBin, TiltTurnsTheBinAndThePileSlides) {
  const auto world = live();
  const auto bin = make_simulated_bin(world);
  bin->command({BinCommand::Kind::tilt, 0.5});
  EXPECT_NEAR(bin->state().tilt_rad, 0.5, 1e-12);
  const auto now = world->now();
  EXPECT_NEAR(rotation_between_rad(now->bins[0].X_WB, Pose::Identity()), 0.5, 1e-9);
  // Parts lie in the tilted bin: above its floor in its own frame.
  double mean_y = 0;
  for (const WorldObject& object : now->objects) {
    const Vector3 p_B = now->bins[0].X_WB.inverse() * object.X_WO.translation();
    EXPECT_GT(p_B.z(), 5);
    mean_y += p_B.y() / static_cast<double>(now->objects.size());
  }
  EXPECT_LT(mean_y, -10);  // downhill
  bin->command({BinCommand::Kind::tilt, 0});
  EXPECT_LT(rotation_between_rad(world->now()->bins[0].X_WB, Pose::Identity()), 1e-12);
}

TEST(SimulatedBin, TheClampHolds) {
  const auto world = live();
  const auto bin = make_simulated_bin(world);
  bin->command({BinCommand::Kind::clamp, 1});
  EXPECT_TRUE(bin->state().clamped);
  const auto before = world->now();
  bin->command({BinCommand::Kind::shake, 1});
  EXPECT_EQ(most_moved_mm(*before, *world->now()), 0);
  bin->command({BinCommand::Kind::tilt, 0.7});
  const auto tilted = world->now();
  for (std::size_t i = 0; i < before->objects.size(); ++i) {
    const Pose X_BO = tilted->bins[0].X_WB.inverse() * tilted->objects[i].X_WO;
    EXPECT_LT(distance_between_mm(before->bins[0].X_WB.inverse() * before->objects[i].X_WO, X_BO), 1e-9);
  }
  EXPECT_THROW(bin->command({BinCommand::Kind::refill, 2}), Error);
  bin->command({BinCommand::Kind::clamp, 0});  // leaning, and let go
  EXPECT_FALSE(bin->state().clamped);
  EXPECT_GT(most_moved_mm(*tilted, *world->now()), 5);
}

TEST(SimulatedBin, LightChangesTheColoursAndNothingElse) {
  const auto world = live();
  const auto bin = make_simulated_bin(world);
  const auto lit = picture(*world);
  bin->command({BinCommand::Kind::light, 0});
  EXPECT_FALSE(bin->state().light_on);
  const auto dark = picture(*world);
  EXPECT_LT(cv::mean(dark->rgb)[0], 0.5 * cv::mean(lit->rgb)[0]);
  EXPECT_TRUE(same_depth(*lit, *dark));
  bin->command({BinCommand::Kind::light, 1});
  EXPECT_EQ(cv::norm(picture(*world)->rgb, lit->rgb, cv::NORM_INF), 0);
}

TEST(SimulatedBin, WeightFollowsThePartsAndRefillBringsThemBack) {
  const auto world = live();
  const auto bin = make_simulated_bin(world);
  // Steel of pi 10^2 50 mm^3 (64 segments: 0.16 % less), and two boxes of 0.1 kg.
  const double full = bin->state().weight_kg;
  EXPECT_NEAR(full, 4 * 7850e-9 * 15708 + 0.2, 0.002);
  while (!world->now()->objects.empty()) {
    const auto objects = world->now()->objects.size();
    const double before = bin->state().weight_kg;
    EXPECT_TRUE(bin->state().part_present);
    ASSERT_TRUE(world->pick(0));
    EXPECT_EQ(world->now()->objects.size(), objects - 1);
    EXPECT_LT(bin->state().weight_kg, before - 0.05);
  }
  EXPECT_EQ(world->picked(0), 6);
  EXPECT_FALSE(bin->state().part_present);
  EXPECT_NEAR(bin->state().weight_kg, 0, 1e-12);
  EXPECT_FALSE(world->pick(0));
  bin->command({BinCommand::Kind::refill, 0});
  EXPECT_EQ(world->now()->objects.size(), 6u);
  EXPECT_NEAR(bin->state().weight_kg, full, 1e-9);
  EXPECT_EQ(world->picked(0), 0);
  bin->command({BinCommand::Kind::refill, 2});
  EXPECT_EQ(world->now()->objects.size(), 8u);
  EXPECT_THROW(bin->command({BinCommand::Kind::refill, -1}), Error);
}

TEST(SimulatedBin, APileThatDoesNotComeToRestIsAFault) {
  World world = parse_world(six_parts, "six.yaml");
  world.physics.steady.time_limit_s = 0.2;
  const auto live_world = std::make_shared<LiveWorld>(world, 1);
  EXPECT_FALSE(live_world->last_settle(0).steady);
  EXPECT_EQ(make_simulated_bin(live_world)->state().fault, fault_not_steady);
  EXPECT_THROW(make_simulated_bin(live_world, 1), Error);
}

TEST(LiveWorld, TwoBinsAreWorldsOfTheirOwn) {
  const char* const two = R"(
parts: [{part: box}]
bins:
  - {name: left, pose: {translation: [-120, 0, 0]}, fill: {box: 3}}
  - {name: right, pose: {translation: [120, 0, 0]}, fill: {box: 3}}
sensors: [{pose: {from: [0, 0, 600], at: [0, 0, 0]}}]
)";
  LiveWorld world(parse_world(two, "two.yaml"), 3);
  const auto before = world.now();
  ASSERT_EQ(before->objects.size(), 6u);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(before->objects[i].X_WO.translation().x() < 0, i < 3);
  world.command(1, {BinCommand::Kind::shake, 1});
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(distance_between_mm(before->objects[i].X_WO, world.now()->objects[i].X_WO), 0);
  }
}

std::string refusal(const std::string& yaml, const std::string& folder = ".") {
  try {
    parse_world(yaml, "bad.yaml", folder);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

const std::string sensor = "sensors: [{pose: {from: [0, 0, 600], at: [0, 0, 0]}}]\n";

TEST(WorldPhysics, EveryReasonWhyPartsCannotFallAtOnce) {
  const std::string text = refusal(sensor + R"(parts:
  - {part: box, density: 133333333}
  - {part: bracket, mass: 4000}
  - {part: cylinder, name: rod}
  - {part: sphere, count: 0}
bins:
  - {fill: {box: 1, bracket: 1, rods: 2}}
  - {name: tiny, inner_size: [45, 20, 40], fill: {rod: 1}}
  - {name: idle, fill: {rod: 0}}
)");
  EXPECT_THAT(text, AllOf(HasSubstr("bad.yaml:3"), HasSubstr("density = 133333333 kg/m^3"), HasSubstr("4000 kg")));
  EXPECT_THAT(text, AllOf(HasSubstr("mass = 4000 kg"), HasSubstr("no material's")));
  EXPECT_THAT(text, AllOf(HasSubstr("rods"), HasSubstr("rod")));  // unknown part, with the nearest
  EXPECT_THAT(text, AllOf(HasSubstr("bin tiny"), HasSubstr("is smaller than the part rod")));
  EXPECT_THAT(text, AllOf(HasSubstr("fill drops 0 parts"), HasSubstr("count drops 0 parts")));
}

TEST(WorldPhysics, AMeshWithAHoleIsNamedAndItsHullOffered) {
  const test::ScratchFolder folder;
  // A tetrahedron without its bottom.
  std::ofstream(folder / "open.obj") << "v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 40\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
  const std::string bin = "bins: [{fill: {open: 2}}]\n";
  const std::string text = refusal(sensor + bin + "parts: [{mesh: open.obj}]\n", folder.path());
  EXPECT_THAT(text, AllOf(HasSubstr("3 open edges"), HasSubstr("collision: hull")));
  const World world = parse_world(sensor + bin + "parts: [{mesh: open.obj, collision: hull}]\n", "w", folder.path());
  EXPECT_EQ(body_of(world.parts[0]).pieces.size(), 1u);
  EXPECT_NEAR(body_of(world.parts[0]).mass.volume_mm3, 40.0 * 40 * 40 / 6, 1);
  // One that only lies there need not be a solid.
  EXPECT_EQ(refusal(sensor + "parts: [{mesh: open.obj, pose: {translation: [0, 0, 0]}}]\n", folder.path()), "");
}

}  // namespace
}  // namespace binrig
