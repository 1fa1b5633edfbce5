// An SDFormat file makes the same World; what is wrong with it is said at once.
#include "sim/sdf_world.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "sim/live_world.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const char* const head = R"(<?xml version="1.0"?>
<sdf version="1.9" xmlns:binrig="https://binrig/sdf"><world name="two boxes"><gravity>0 0 -9.81</gravity>
<model name="table"><static>true</static><link name="l"><collision name="c"><geometry><plane/></geometry></collision></link></model>
<model name="bin"><static>true</static><pose>0.01 0 0 0 0 0</pose><link name="l"/>
  <binrig:bin><binrig:inner_size>0.21 0.16 0.08</binrig:inner_size><binrig:wall>0.005</binrig:wall></binrig:bin></model>
<model name="eye"><static>true</static><pose>0 0 0.8 0 1.5707963267948966 0</pose><link name="l">
  <sensor name="above" type="depth_camera"><update_rate>3</update_rate>
  <camera><horizontal_fov>0.28</horizontal_fov><image><width>640</width><height>480</height></image>
  <clip><near>0.1</near><far>2</far></clip></camera></sensor></link></model>
)";

std::string box(const std::string& name, const std::string& more = "") {
  return "<model name=\"" + name + "\"><link name=\"l\"><inertial><mass>0.2</mass></inertial><collision name=\"c\">" +
         "<geometry><box><size>0.05 0.03 0.02</size></box></geometry><surface><friction><ode><mu>0.3</mu></ode>" +
         "</friction></surface></collision></link>" + more + "</model>\n";
}

class SdfWorld : public testing::Test {
 protected:
  std::string file(const std::string& text) {
    std::ofstream(folder_ / "w.sdf") << text;
    return folder_ / "w.sdf";
  }
  std::string refusal(const std::string& text) {
    try {
      read_world(file(text));
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
  void SetUp() override {
    const std::string text = refusal("<sdf/>");
    if (text.find("without libsdformat") != std::string::npos) GTEST_SKIP() << "this build has no libsdformat";
  }
  test::ScratchFolder folder_;
};

TEST_F(SdfWorld, IsTheSameWorldInMillimetres) {
  const World world = read_world(file(std::string(head) + box("one") + box("two") + "</world></sdf>"));
  EXPECT_EQ(world.name, "two boxes");
  EXPECT_NEAR(world.physics.gravity_mm_s2, 9810, 1e-6);
  ASSERT_EQ(world.parts.size(), 1u);  // one geometry, one kind
  EXPECT_EQ(world.parts[0].count, 2);
  EXPECT_DOUBLE_EQ(*world.parts[0].mass_kg, 0.2);
  EXPECT_DOUBLE_EQ(world.parts[0].friction, 0.3);
  ASSERT_EQ(world.bins.size(), 1u);
  EXPECT_NEAR((world.bins[0].inner_size_mm - Vector3(210, 160, 80)).norm(), 0, 1e-9);
  EXPECT_NEAR(world.bins[0].wall_mm, 5, 1e-9);
  EXPECT_NEAR(world.bins[0].X_WB.translation().x(), 10, 1e-9);
  ASSERT_TRUE(world.table.has_value());
  ASSERT_EQ(world.sensors.size(), 1u);
  EXPECT_EQ(world.sensors[0].camera->width, 640);
  // Pitched down by 90 degrees, 800 mm up: the origin lies on its axis.
  EXPECT_LT((world.sensors[0].X_WC[0].inverse() * Vector3::Zero() - Vector3(0, 0, 800)).norm(), 1e-6);
  EXPECT_EQ(LiveWorld(world, 1).now()->objects.size(), 2u);
}

TEST_F(SdfWorld, AllThatIsWrongIsListed) {
  const std::string text = refusal(
      std::string(head) + box("one", "<colour>red</colour>") +
      "<model name=\"gone\"><link name=\"l\"><collision name=\"c\"><geometry><mesh><uri>nowhere.stl</uri></mesh>"
      "</geometry></collision></link></model></world></sdf>");
  EXPECT_THAT(text, AllOf(HasSubstr("colour"), HasSubstr("nowhere.stl"), HasSubstr("model gone")));
  EXPECT_THAT(refusal("<sdf version='1.9'><world name='x'>"), HasSubstr("w.sdf"));
}

}  // namespace
}  // namespace binrig
