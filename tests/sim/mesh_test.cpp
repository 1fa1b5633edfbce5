#include "sim/mesh.h"

#include <fstream>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "sim/part_models.h"

namespace binrig {
namespace {

std::string write(const std::string& name, const std::string& text) {
  const std::string path = testing::TempDir() + "/" + name;
  std::ofstream(path) << text;
  return path;
}

std::string problem_of(const std::string& path, LengthUnit unit = LengthUnit::mm) {
  try {
    load_mesh(path, unit);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

const char* const tetrahedron = "v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

std::string stl_of(const Mesh& mesh) {
  std::string text = "solid part\n";
  for (const auto& t : mesh.triangles) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (const auto v : t) {
      const auto& p = mesh.vertices[v];
      text += "vertex " + std::to_string(p.x()) + " " + std::to_string(p.y()) + " " + std::to_string(p.z()) + "\n";
    }
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid part\n";
}

TEST(LoadMesh, UnitsAreTurnedIntoMillimetres) {
  const std::string path = write("t.obj", tetrahedron);
  const double volume = 30 * 30 * 30 / 6.0;
  EXPECT_NEAR(closedness(*load_mesh(path)).volume_mm3, volume, 1e-2);
  EXPECT_NEAR(closedness(*load_mesh(path, LengthUnit::cm)).volume_mm3 / 1e3, volume, 1e-2);
  EXPECT_NEAR(closedness(*load_mesh(path, LengthUnit::inch)).volume_mm3 / std::pow(25.4, 3), volume, 1e-2);
}

TEST(LoadMesh, EqualVerticesAreMergedSoThatStlIsWatertight) {
  const PartModel part = part_model("socket");
  const auto read = load_mesh(write("socket.stl", stl_of(*part.mesh)));
  EXPECT_EQ(read->vertices.size(), part.mesh->vertices.size());
  EXPECT_EQ(read->triangles.size(), part.mesh->triangles.size());
  EXPECT_TRUE(closedness(*read).closed);
  EXPECT_TRUE(read->surfaces.front().assumed);
}

TEST(LoadMesh, ColladaBringsItsOwnUnit) {
  const char* const dae = R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="UNIT" meter="METER"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 30 0 0 0 20 0 0 0 10</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
  std::string in_mm = dae, in_m = dae;
  in_mm.replace(in_mm.find("METER"), 5, "0.001");
  in_m.replace(in_m.find("METER"), 5, "1");
  Eigen::Vector3f low, high;
  load_mesh(write("mm.dae", in_mm))->bounds(low, high);
  EXPECT_TRUE((high - low).isApprox(Eigen::Vector3f(30, 20, 10), 1e-5f)) << (high - low).transpose();
}

TEST(LoadMesh, SaysWhatIsWrong) {
  using testing::HasSubstr;
  EXPECT_THAT(problem_of("nowhere.stl"), HasSubstr("no such file"));
  EXPECT_THAT(problem_of(write("broken.ply", "ply\nformat ascii 1.0\nelement vertex 3\n")), HasSubstr("broken.ply"));
  EXPECT_THAT(problem_of(write("short.ply",
                               "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                               "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                               "end_header\n0 0 0\n30 0 0\n")),
              HasSubstr("short.ply"));
  EXPECT_THAT(problem_of(write("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")), HasSubstr("points.obj"));
  EXPECT_THAT(problem_of(write("metres.obj", "v 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nf 1 2 3\n")), HasSubstr("metres"));
  EXPECT_EQ(problem_of(write("metres.obj", "v 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nf 1 2 3\n"), LengthUnit::m), "");
  EXPECT_THAT(problem_of(write("huge.obj", "v 0 0 0\nv 50000 0 0\nv 0 50000 0\nf 1 2 3\n")), HasSubstr("unit"));
}

TEST(LoadMesh, VerticesThatAreNotNumbersAreCounted) {
  // Binary STL, since the text formats' readers know no NaN.
  std::string bytes(80, ' ');
  const auto put = [&](auto value) { bytes.append(reinterpret_cast<const char*>(&value), sizeof value); };
  put(std::uint32_t{2});
  for (int t = 0; t < 2; ++t) {
    for (int i = 0; i < 12; ++i) put(i == 5 ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(i * i * 3));
    put(std::uint16_t{0});
  }
  EXPECT_THAT(problem_of(write("nan.stl", bytes)), testing::HasSubstr("2 of its vertices are not numbers"));
}

TEST(LoadMesh, FiveMillionTrianglesAreRefusedWithTheirNumber) {
  const std::uint32_t count = 5'000'000;
  std::string bytes(80, ' ');
  bytes.append(reinterpret_cast<const char*>(&count), 4);
  const std::size_t start = bytes.size();
  bytes.resize(start + std::size_t{count} * 50, '\0');
  for (std::uint32_t t = 0; t < count; ++t) {
    const float corners[9] = {static_cast<float>(t % 1000), static_cast<float>(t / 1000), 0, 1, 2, 3, 4, 5, 6};
    std::memcpy(bytes.data() + start + std::size_t{t} * 50 + 12, corners, sizeof corners);
  }
  const std::string path = write("five_million.stl", bytes);
  EXPECT_THAT(problem_of(path), testing::HasSubstr("5000000 triangles"));
  std::remove(path.c_str());
}

class BuiltInPart : public testing::TestWithParam<std::string> {};

TEST_P(BuiltInPart, IsWatertightAndAbout50mm) {
  const PartModel part = part_model(GetParam());
  const Closedness shape = closedness(*part.mesh);
  EXPECT_TRUE(shape.closed);
  EXPECT_GT(shape.volume_mm3, 500);
  EXPECT_GT(diameter_mm(*part.mesh), 35);
  EXPECT_LT(diameter_mm(*part.mesh), 65);
  Eigen::Vector3f low, high;
  part.mesh->bounds(low, high);
  EXPECT_LT((low + high).norm(), 1e-3);
}

// Distance of p from the surface's vertices would say nothing on big triangles; compare supporting planes instead: the
// extents along many directions are the same before and after a symmetry.
TEST_P(BuiltInPart, LooksTheSameAfterItsSymmetries) {
  const PartModel part = part_model(GetParam());
  std::vector<Pose> poses = part.symmetries.discrete;
  for (const auto& axis : part.symmetries.continuous) {
    // A polygonal approximation is the same only after whole segments: 2 pi / 64.
    poses.push_back(Pose(Eigen::AngleAxisd(2 * EIGEN_PI / 64 * 5, axis.direction)));
  }
  // A sphere of rings and segments is the same about z to rounding, about x and y to its facets' sagitta.
  const double tolerance = GetParam() == "sphere" ? 20 * (1 - std::cos(EIGEN_PI / 64)) * 2 : 1e-3;
  for (const Pose& X : poses) {
    for (int i = 0; i < 200; ++i) {
      const Vector3 d = Vector3(std::sin(i * 1.7), std::cos(i * 2.3), std::sin(i * 0.9 + 1)).normalized();
      double before = 0, after = 0;
      for (const auto& v : part.mesh->vertices) {
        before = std::max(before, d.dot(v.cast<double>()));
        after = std::max(after, d.dot(X * v.cast<double>()));
      }
      EXPECT_NEAR(before, after, tolerance) << X.matrix();
    }
  }
}

TEST_P(BuiltInPart, SubdividedIsTheSameSolid) {
  const PartModel part = part_model(GetParam());
  const auto fine = subdivided(*part.mesh, 20'000);
  EXPECT_GE(fine->triangles.size(), 20'000u);
  EXPECT_TRUE(closedness(*fine).closed);
  EXPECT_NEAR(closedness(*fine).volume_mm3 / closedness(*part.mesh).volume_mm3, 1, 1e-4);
}

INSTANTIATE_TEST_SUITE_P(All, BuiltInPart, testing::ValuesIn(part_names()));

TEST(PartModel, UnknownNamesGetTheNearestKnownOne) {
  try {
    part_model("brakcet");
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("did you mean bracket"));
  }
}

TEST(Diameter, OfABoxIsItsDiagonal) {
  EXPECT_NEAR(diameter_mm(*box_mesh({30, 40, 120}, Surface{})), 130, 1e-4);
  EXPECT_NEAR(diameter_mm(*subdivided(*box_mesh({30, 40, 120}, Surface{}), 10'000)), 130, 0.13);
}

}  // namespace
}  // namespace binrig
