// Volumes, centres and inertias against textbook formulas; what is not a solid is named.
#include "sim/mass_properties.h"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/part_models.h"

namespace binrig {
namespace {

using testing::HasSubstr;

Mesh box() { return *box_mesh(Eigen::Vector3d(20, 30, 50), Surface{}); }

std::string complaints(const Mesh& mesh) {
  Violations violations;
  check_solid(mesh, "part.stl", violations);
  std::string all;
  for (const Violation& v : violations.list()) all += v.text() + "\n";
  return all;
}

TEST(MassProperties, OfABoxAnywhereAreTheTextbooks) {
  Mesh mesh = box();
  for (auto& v : mesh.vertices) v += Eigen::Vector3f(100, -40, 7);
  const MassProperties p = mass_properties(mesh, 1000);
  const double m = 20 * 30 * 50 * 1e-6;  // 1000 kg/m^3 = 1e-6 kg/mm^3
  EXPECT_NEAR(p.volume_mm3, 30000, 1e-3);
  EXPECT_NEAR(p.mass_kg, m, 1e-9);
  EXPECT_LT((p.centre_mm - Vector3(100, -40, 7)).norm(), 1e-5);
  EXPECT_NEAR(p.inertia_kg_mm2(0, 0), m / 12 * (900 + 2500), 1e-6);
  EXPECT_NEAR(p.inertia_kg_mm2(1, 1), m / 12 * (400 + 2500), 1e-6);
  EXPECT_NEAR(p.inertia_kg_mm2(2, 2), m / 12 * (400 + 900), 1e-6);
  EXPECT_NEAR(p.inertia_kg_mm2(0, 1), 0, 1e-6);
}

TEST(MassProperties, ScaleWithTheMassThatIsGiven) {
  const MassProperties p = with_mass(mass_properties(box(), 1000), 0.3);
  EXPECT_DOUBLE_EQ(p.mass_kg, 0.3);
  EXPECT_NEAR(p.inertia_kg_mm2(2, 2), 0.3 / 12 * 1300, 1e-6);
}

TEST(MassProperties, EveryPartOfOursIsASolid) {
  for (const std::string& name : part_names()) EXPECT_EQ(complaints(*part_model(name).mesh), "") << name;
}

TEST(CheckSolid, NamesTheOpenEdgesOfAHole) {
  Mesh mesh = box();
  mesh.triangles.pop_back();
  const std::string text = complaints(mesh);
  EXPECT_THAT(text, HasSubstr("3 open edges"));
  EXPECT_THAT(text, HasSubstr("part.stl"));
  EXPECT_THAT(text, HasSubstr("collision: hull"));  // offered, not taken
}

TEST(CheckSolid, NamesInvertedAndContraryWinding) {
  Mesh inside_out = box();
  for (auto& t : inside_out.triangles) std::swap(t[0], t[1]);
  EXPECT_THAT(complaints(inside_out), HasSubstr("wound inwards"));
  Mesh contrary = box();
  std::swap(contrary.triangles[0][0], contrary.triangles[0][1]);
  EXPECT_THAT(complaints(contrary), HasSubstr("face opposite ways"));
}

TEST(CheckSolid, NamesZeroVolume) {
  Mesh sheet;  // both sides of one triangle
  sheet.vertices = {{0, 0, 0}, {50, 0, 0}, {0, 50, 0}};
  sheet.triangles = {{0, 1, 2}, {0, 2, 1}};
  EXPECT_THAT(complaints(sheet), HasSubstr("encloses nothing"));
}

TEST(CheckDensity, NamesTheMassThatAWrongUnitMakes) {
  // 50 mm cube of 4 tonnes: somebody wrote kg/m^3 times a thousand too much and more.
  Violations violations;
  check_density(3.2e7, 125000, "world.yaml:7", "density", violations);
  ASSERT_EQ(violations.list().size(), 1u);
  EXPECT_THAT(violations.list()[0].text(), HasSubstr("4000 kg"));
  Violations grams;
  check_density(7.85, 125000, "world.yaml:7", "density", grams);  // g/cm^3
  ASSERT_EQ(grams.list().size(), 1u);
  EXPECT_THAT(grams.list()[0].text(), HasSubstr("1 g/cm^3 = 1000 kg/m^3"));
  Violations none;
  check_density(7850, 125000, "world.yaml:7", "density", none);
  EXPECT_TRUE(none.empty());
}

}  // namespace
}  // namespace binrig
