#include "sim/world.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"

namespace binrig {
namespace {

const char* const good = R"(
name: two parts
parts:
  - part: cylinder
    surfaces:
      - {albedo: 0.4, specular: 0.6, shininess: 20}
      - {albedo: 0.7, half_space: [0, 0, 1, 0]}
    poses:
      - {translation: [10, 0, 20]}
      - {translation: [-30, 0, 20], rotation_vector_deg: [90, 0, 0]}
  - {part: wrench, count: 3, density: 7850}
bins:
  - {inner_size: [210, 160, 80]}
table: {height: -4, surface: {albedo: 0.3}}
sensors:
  - name: above
    pose: {from: [0, 0, 800], at: [0, 0, 0], up: [0, 1, 0]}
    camera: {width: 128, height: 96, horizontal_fov_deg: 16}
    projector: [100, 0, 0]
)";

TEST(World, IsReadAndSeen) {
  const World world = parse_world(good, "good.yaml");
  ASSERT_EQ(world.parts.size(), 2u);
  EXPECT_EQ(world.objects.size(), 2u);
  EXPECT_TRUE(world.drops());
  EXPECT_EQ(world.parts[1].count, 3);
  ASSERT_EQ(world.sensors.size(), 1u);
  EXPECT_EQ(world.sensors[0].camera->width, 128);

  const Pose& X_WC = world.sensors[0].X_WC[0];
  EXPECT_TRUE((X_WC * Vector3(0, 0, 800)).isZero(1e-9));     // looks at the origin
  EXPECT_GT((X_WC.linear() * Vector3(0, -1, 0)).y(), 0.99);  // up is up in the image
  EXPECT_NEAR(X_WC.linear().determinant(), 1, 1e-12);

  const RenderScene scene = render_scene(world, X_WC);
  ASSERT_EQ(scene.objects.size(), 3u);  // two cylinders and the bin
  EXPECT_EQ(scene.objects[0].obj_id, 1);
  EXPECT_EQ(scene.objects[2].obj_id, 0);
  const Channels seen = *make_renderer("embree")->render(
      scene,
      {*world.sensors[0].camera, world.sensors[0].info.projector_xyz_mm, 800, Channel::depth | Channel::instance});
  // The bin's floor is at z = 0, so 800 mm below the camera.
  EXPECT_NEAR(seen.depth_mm.at<float>(10, 64), 800, 1e-3);
  EXPECT_EQ(seen.instance.at<std::uint16_t>(10, 64), 3);
}

TEST(World, AHalfSpaceHasASurfaceOfItsOwn) {
  const World world = parse_world(good, "good.yaml");
  const Mesh& mesh = *world.parts[0].model.mesh;
  ASSERT_EQ(mesh.surfaces.size(), 2u);
  EXPECT_TRUE(closedness(mesh).closed);
  EXPECT_NEAR(closedness(mesh).volume_mm3, closedness(*part_model("cylinder").mesh).volume_mm3, 0.5);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    float z = 0;
    for (const auto v : mesh.triangles[t]) z += mesh.vertices[v].z() / 3;
    EXPECT_FLOAT_EQ(mesh.surface_of(t).albedo, z > 0 ? 0.7f : 0.4f);
  }
}

TEST(World, EveryViolationIsReportedAtOnceWithItsLine) {
  try {
    parse_world(R"(name: bad
parts:
  - {part: cilinder, friction: -1}
  - {mesh: nowhere.stl, colour: red}
  - {part: box, pose: {translation: [0, 0]}}
  - {part: box, surfaces: [{albedo: 2}], symmetries_discrete: [[1, 2]]}
bins:
  - {inner_size: [210, 160, -80]}
sensors:
  - {pose: {from: [0, 0, 0], at: [0, 5, 0], up: [0, 1, 0]}, model: gone.yaml}
lamps: []
)",
                "bad.yaml");
    FAIL() << "accepted";
  } catch (const Error& error) {
    const std::string all = error.what();
    for (const char* expected : {"bad.yaml:3", "cylinder", "friction", "nowhere.stl", "colour", "translation", "albedo",
                                 "16 numbers", "inner_size", "viewing direction", "gone.yaml", "lamps"}) {
      EXPECT_THAT(all, testing::HasSubstr(expected));
    }
  }
}

TEST(World, AnInsideOutMeshIsRefusedAndSaysSo) {
  const std::string folder = testing::TempDir();
  {
    std::ofstream obj(folder + "/inverted.obj");
    obj << "v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";
  }
  try {
    parse_world("parts: [{mesh: inverted.obj, pose: {}}]\nsensors: [{pose: {translation: [0, 0, 0]}}]\n", "w.yaml",
                folder);
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("inside out"));
  }
}

TEST(World, TheBinIsWatertight) {
  const auto mesh = bin_mesh({210, 160, 80}, 4, Surface{});
  const Closedness shape = closedness(*mesh);
  EXPECT_TRUE(shape.closed);
  EXPECT_NEAR(shape.volume_mm3, 218.0 * 168 * 84 - 210.0 * 160 * 80, 1);
}

}  // namespace
}  // namespace binrig
