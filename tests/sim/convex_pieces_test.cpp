// The pieces cover the solid, add little to it, and are few.
#include "sim/convex_pieces.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "core/random.h"
#include "sim/convex_hull.h"
#include "sim/mass_properties.h"
#include "sim/part_models.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

namespace fs = std::filesystem;

std::vector<Vector3> cloud(int count, std::uint64_t seed) {
  const RandomStream draws(seed);
  std::vector<Vector3> points;
  for (int i = 0; i < count; ++i) {
    points.emplace_back(40 * draws.uniform(3 * i), 30 * draws.uniform(3 * i + 1), 20 * draws.uniform(3 * i + 2));
  }
  return points;
}

TEST(ConvexHull, HoldsEveryPointAndTouchesEveryFace) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto points = cloud(200, seed);
    const ConvexHull hull = convex_hull(points);
    EXPECT_GT(hull.volume_mm3, 0);
    // A ten-thousandth of the extent, 54 mm.
    for (const Vector3& p : points) EXPECT_LE(hull.outside_mm(p), 6e-3);
    for (const HalfSpace& face : hull.faces) {
      int touching = 0;
      for (const Vector3& v : hull.vertices) touching += std::abs(face.outside_mm(v)) < 6e-3;
      EXPECT_GE(touching, 3);
    }
  }
  EXPECT_EQ(convex_hull({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}).volume_mm3, 0);
}

TEST(ConvexHull, SimplifiedLiesInsideAndWithinItsTolerance) {
  const auto mesh = sphere_mesh(20, 64, Surface{});
  std::vector<Vector3> points;
  for (const auto& v : mesh->vertices) points.push_back(v.cast<double>());
  const ConvexHull hull = convex_hull(points), fewer = simplified_hull(hull, 0.3);
  EXPECT_LT(fewer.vertices.size(), hull.vertices.size() / 4);
  for (const Vector3& v : fewer.vertices) EXPECT_LE(hull.outside_mm(v), 6e-3);
  for (const Vector3& v : hull.vertices) EXPECT_LE(fewer.outside_mm(v), 0.3);
}

TEST(ConvexPieces, EveryPartOfOursIsCoveredByFewFatPieces) {
  for (const std::string& name : part_names()) {
    const auto mesh = part_model(name).mesh;
    const ConvexPieces pieces = convex_pieces(*mesh);
    EXPECT_LE(pieces.pieces.size(), 10u) << name;
    EXPECT_LE(pieces.quality.hausdorff_mm, 0.5) << name;
    EXPECT_LE(std::abs(pieces.quality.volume_error), 0.01) << name;
    std::vector<ConvexHull> hulls;
    for (const ConvexPiece& piece : pieces.pieces) {
      if (piece.points.size() > 1) hulls.push_back(convex_hull(piece.points));
    }
    for (const auto& v : mesh->vertices) {
      double outside = 1e9;
      for (const ConvexHull& hull : hulls) outside = std::min(outside, hull.outside_mm(v.cast<double>()));
      for (const ConvexPiece& piece : pieces.pieces) {
        if (piece.points.size() == 1) {
          outside = std::min(outside, (v.cast<double>() - piece.points[0]).norm() - piece.radius_mm);
        }
      }
      EXPECT_LE(outside, DecompositionSettings{}.simplify_mm + 6e-3) << name;
    }
  }
}

TEST(ConvexPieces, AnAngleIronIsTwoBoxesExactly) {
  const auto mesh = prism_mesh({{0, 0}, {30, 0}, {30, 4}, {4, 4}, {4, 20}, {0, 20}}, 50, Surface{});
  const ConvexPieces pieces = convex_pieces(*mesh);
  EXPECT_EQ(pieces.pieces.size(), 2u);
  EXPECT_NEAR(pieces.quality.volume_error, 0, 1e-6);
  EXPECT_NEAR(pieces.quality.hausdorff_mm, 0, 1e-4);
}

TEST(ConvexPieces, AHullIsWorseAndSaysSo) {
  const auto mesh = part_model("bracket").mesh;
  const ConvexPieces hull = hull_piece(*mesh);
  EXPECT_EQ(hull.pieces.size(), 1u);
  EXPECT_GT(hull.quality.hausdorff_mm, 5);
  EXPECT_GT(hull.quality.volume_error, 1);
}

TEST(ConvexPieces, ABallIsABall) {
  const ConvexPieces pieces = convex_pieces(*sphere_mesh(20, 64, Surface{}));
  ASSERT_EQ(pieces.pieces.size(), 1u);
  ASSERT_EQ(pieces.pieces[0].points.size(), 1u);
  EXPECT_NEAR(pieces.pieces[0].radius_mm, 20, 0.05);
}

class PiecesCache : public testing::Test {
 protected:
  void SetUp() override {
    if (const char* old = std::getenv("XDG_CACHE_HOME")) before_ = old;
    setenv("XDG_CACHE_HOME", scratch_.path().c_str(), 1);
  }
  void TearDown() override {
    if (before_.empty()) {
      unsetenv("XDG_CACHE_HOME");
    } else {
      setenv("XDG_CACHE_HOME", before_.c_str(), 1);
    }
  }
  std::vector<fs::path> files() const {
    std::vector<fs::path> found;
    for (const auto& entry : fs::recursive_directory_iterator(scratch_.path())) {
      if (entry.is_regular_file()) found.push_back(entry.path());
    }
    return found;
  }
  static bool same(const ConvexPieces& a, const ConvexPieces& b) {
    if (a.pieces.size() != b.pieces.size() || a.quality.hausdorff_mm != b.quality.hausdorff_mm) return false;
    for (std::size_t i = 0; i < a.pieces.size(); ++i) {
      if (a.pieces[i].points != b.pieces[i].points || a.pieces[i].radius_mm != b.pieces[i].radius_mm) return false;
    }
    return true;
  }

  test::ScratchFolder scratch_;
  std::string before_;
  std::shared_ptr<const Mesh> mesh_ = part_model("bracket").mesh;
};

TEST_F(PiecesCache, GivesBackWhatWasCutBitForBit) {
  const ConvexPieces cut = convex_pieces(*mesh_);
  EXPECT_TRUE(same(cut, cached_convex_pieces(*mesh_)));
  ASSERT_EQ(files().size(), 1u);
  const auto written = fs::last_write_time(files()[0]);
  EXPECT_TRUE(same(cut, cached_convex_pieces(*mesh_)));
  EXPECT_EQ(fs::last_write_time(files()[0]), written);  // it was read
  cached_convex_pieces(*part_model("box").mesh);
  DecompositionSettings coarse;
  coarse.most_pieces = 2;
  EXPECT_EQ(cached_convex_pieces(*mesh_, coarse).pieces.size(), 2u);
  EXPECT_EQ(files().size(), 3u);
}

TEST_F(PiecesCache, HalfAFileIsMadeAnew) {
  const ConvexPieces cut = cached_convex_pieces(*mesh_);
  ASSERT_EQ(files().size(), 1u);
  const auto whole = fs::file_size(files()[0]);
  fs::resize_file(files()[0], whole / 2);
  EXPECT_TRUE(same(cut, cached_convex_pieces(*mesh_)));
  EXPECT_EQ(fs::file_size(files()[0]), whole);
}

TEST_F(PiecesCache, AFolderThatCannotBeMadeIsNoError) {
  const std::string blocked = scratch_ / "a_file";
  std::ofstream(blocked) << "not a folder";
  setenv("XDG_CACHE_HOME", blocked.c_str(), 1);
  EXPECT_EQ(cached_convex_pieces(*part_model("box").mesh).pieces.size(), 1u);
}

}  // namespace
}  // namespace binrig
