// The nine worlds of the physics can be read, dropped and seen whole.
#include <cctype>
#include <string>

#include <gtest/gtest.h>

#include "sim/live_world.h"
#include "sim/world.h"

namespace binrig {
namespace {

TEST(ShippedWorlds, AreReadDroppedAndSeen) {
  for (const std::string name : {"plane", "cylinder-9", "cylinder-18", "bracket-9", "bracket-18", "wrench-9",
                                 "wrench-18", "mixed-18", "two-bins"}) {
    const World world = read_world(std::string(BINRIG_SOURCE_DIR) + "/worlds/" + name + ".yaml");
    EXPECT_EQ(world.name, name);
    int parts = 0;
    for (const WorldBin& bin : world.bins) {
      for (const auto& [part, count] : bin.fill) parts += count;
    }
    // The name ends in the number of parts.
    const std::string number = world.name.substr(world.name.rfind('-') + 1);
    if (std::isdigit(number.front())) {
      EXPECT_EQ(parts, std::stoi(number)) << world.name;
    }
    if (number == "18" && world.name != "mixed-18") continue;  // as those of 9, only slower
    const LiveWorld live(world, 1);
    EXPECT_EQ(static_cast<int>(live.now()->objects.size()), parts) << world.name;
    for (int i = 0; i < live.bins(); ++i) EXPECT_TRUE(live.last_settle(i).steady) << world.name;
    // The rim of every bin lies in somebody's image.
    for (const WorldBin& bin : world.bins) {
      bool whole = false;
      for (const WorldSensor& sensor : world.sensors) {
        bool inside = true;
        for (const auto& v : bin.mesh->vertices) {
          const Vector3 p_C = sensor.X_WC[0].inverse() * bin.X_WB * v.cast<double>();
          const Eigen::Vector2d uv = sensor.camera->project(p_C);
          inside = inside && uv.x() > 0 && uv.y() > 0 && uv.x() < sensor.camera->width - 1 &&
                   uv.y() < sensor.camera->height - 1;
        }
        whole = whole || inside;
      }
      EXPECT_TRUE(whole) << world.name << " " << bin.name;
    }
  }
}

}  // namespace
}  // namespace binrig
