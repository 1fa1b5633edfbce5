#include "sim/renderer.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/random.h"
#include "core/ray_table.h"
#include "sim/offscreen_gl.h"
#include "sim/part_models.h"

#if defined(__SANITIZE_ADDRESS__)
// OSMesa keeps some hundred bytes for each context that was ever current.
extern "C" const char* __lsan_default_suppressions() { return "leak:libOSMesa.so\n"; }
#endif

namespace binrig {
namespace {

constexpr ChannelSet everything = 0x7ff;
constexpr double deg = EIGEN_PI / 180;

Camera small_camera() { return camera_from_field_of_view(320, 240, 20 * deg); }
Camera lens_camera() {
  Camera camera = camera_from_field_of_view(640, 480, 50 * deg);
  camera.distortion = {-0.2, 0.05, 0.002, -0.001, 0.01, 0, 0, 0};
  return camera;
}

Pose random_pose(const RandomStream& draws, std::uint64_t i, const Vector3& middle, const Vector3& spread) {
  const Eigen::Quaterniond turn(draws.normal(8 * i), draws.normal(8 * i + 1), draws.normal(8 * i + 2),
                                draws.normal(8 * i + 3));
  Pose X(turn.normalized());
  for (int k = 0; k < 3; ++k) {
    const double u = draws.uniform(1000 + 8 * i + static_cast<std::uint64_t>(k));
    X.pretranslate(Vector3(Vector3::Unit(k) * (middle[k] + (2 * u - 1) * spread[k])));
  }
  return X;
}

// Parts at random before a wall.
RenderScene random_scene(std::uint64_t seed, int parts, double half_width_mm) {
  const RandomStream draws = RandomStream(seed).child("scene");
  RenderScene scene;
  scene.plane = ScenePlane{Vector3(0.1, -0.2, -1).normalized(), 0, {}};
  scene.plane->offset_mm = scene.plane->normal.dot(Vector3(0, 0, 850));
  const auto names = part_names();
  for (int i = 0; i < parts; ++i) {
    const auto n = static_cast<std::uint64_t>(i);
    const Surface surface{static_cast<float>(draws.uniform(5000 + n)),
                          static_cast<float>(draws.uniform(6000 + n)),
                          20.f,
                          {0.6f, 0.5f, 0.4f},
                          false};
    scene.objects.push_back({part_model(names[n % names.size()], surface).mesh,
                             random_pose(draws, n, {0, 0, 780}, {half_width_mm, half_width_mm * 0.75, 40}), i + 1});
  }
  return scene;
}

// Pixels at least `px` away from where the instance changes or depth jumps.
cv::Mat away_from_edges(const Channels& c, float px) { return c.edge_px > px; }

int count_if(const cv::Mat& mask) { return cv::countNonZero(mask); }

class EachRenderer : public testing::TestWithParam<std::string> {
 protected:
  std::unique_ptr<Renderer> renderer = make_renderer(GetParam());
};
INSTANTIATE_TEST_SUITE_P(All, EachRenderer, testing::Values("embree", "osmesa"),
                         [](const auto& info) { return info.param; });

// ------------------------------------------------------------------------------------------- against formulas

// Depth is stored as a float: 800 mm has steps of 6e-5 mm; the ray table's coordinates are floats, too, which at 60
// degrees adds 1e-4 mm.
TEST_P(EachRenderer, APlaneOfTwoTrianglesHasTheDepthOfThePlane) {
  for (const Camera& camera : {small_camera(), lens_camera()}) {
    for (double tilt : {0.0, 20.0, 40.0, 60.0}) {
      if (camera.distorted() && tilt > 50) continue;  // the plane's horizon would be in the picture
      RenderScene scene;
      Pose X(Eigen::AngleAxisd(tilt * deg, Vector3(0.6, 0.8, 0)));
      X.pretranslate(Vector3(3, -5, 800));
      scene.objects.push_back({rectangle_mesh(4000, 4000, Surface{}), X, 1});
      const auto c = renderer->render(scene, {camera, Vector3(100, 0, 0), 800, everything});
      const Vector3 n = X.linear().col(2);
      double worst = 0, worst_cosine = 0;
      for (int v = 0; v < camera.height; v += 3) {
        for (int u = 0; u < camera.width; u += 3) {
          const Vector3 ray = camera.ray(u, v);
          worst = std::max(worst, std::abs(c->depth_mm.at<float>(v, u) - n.dot(X.translation()) / n.dot(ray)));
          worst_cosine =
              std::max(worst_cosine, std::abs(c->cos_incidence.at<float>(v, u) - std::abs(n.dot(ray.normalized()))));
        }
      }
      EXPECT_LT(worst, 1e-3) << GetParam() << " tilt " << tilt << (camera.distorted() ? " distorted" : "");
      EXPECT_LT(worst_cosine, 1e-5);
      EXPECT_EQ(count_if(c->projector_gap_mm > 0), 0);  // a plane does not shade itself
    }
  }
}

// The sphere's facets lie inside it by at most the sagitta r (1 - cos(pi / n)) in both directions: 0.0012 mm for n =
// 400 and r = 20, seen at up to 75 degrees: 0.0048 mm.
TEST_P(EachRenderer, ASphereHasTheDepthOfASphere) {
  for (const Camera& camera : {small_camera(), lens_camera()}) {
    const double radius = 20, steepest = GetParam() == "osmesa" && camera.distorted() ? 60 * deg : 75 * deg;
    const Vector3 centre(10, -8, 400);
    RenderScene scene;
    scene.objects.push_back({sphere_mesh(radius, 300, Surface{}), Pose(Eigen::Translation3d(centre)), 1});
    const auto c = renderer->render(scene, {camera, Vector3(100, 0, 0), 400, everything});
    int checked = 0;
    double worst = 0;
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 0; u < camera.width; ++u) {
        const Vector3 ray = camera.ray(u, v);
        const double a = ray.squaredNorm(), b = ray.dot(centre),
                     d = b * b - a * (centre.squaredNorm() - radius * radius);
        if (d < 0) continue;
        const double z = (b - std::sqrt(d)) / a;
        const double cosine = -ray.normalized().dot((z * ray - centre) / radius);
        if (cosine < std::cos(steepest)) continue;
        worst = std::max(worst, std::abs(c->depth_mm.at<float>(v, u) - z));
        // Lit up to the terminator; a facet's width before and behind it may be either.
        const double n_light = (Vector3(100, 0, 0) - z * ray).normalized().dot((z * ray - centre) / radius);
        if (std::abs(n_light) > 0.03) {
          EXPECT_EQ(c->projector_gap_mm.at<float>(v, u) > shadow_epsilon_mm, n_light < 0) << u << " " << v;
        }
        ++checked;
      }
    }
    EXPECT_GT(checked, 500);
    EXPECT_LT(worst, 0.01) << GetParam();
  }
}

TEST_P(EachRenderer, ACylinderHasTheDepthOfACylinder) {
  const Camera camera = small_camera();
  const double radius = 15;
  Pose X(Eigen::AngleAxisd(1.1, Vector3(0.3, 0.9, -0.2).normalized()));
  X.pretranslate(Vector3(-5, 4, 600));
  RenderScene scene;
  scene.objects.push_back({cylinder_mesh(radius, 60, 720, Surface{}), X, 1});
  const auto c = renderer->render(scene, {camera, std::nullopt, 600, everything});
  const Pose X_OC = X.inverse();
  int checked = 0;
  double worst = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Vector3 ray = camera.ray(u, v), o = X_OC.translation(), d = X_OC.linear() * ray;
      const double a = d.head<2>().squaredNorm(), b = o.head<2>().dot(d.head<2>());
      const double discriminant = b * b - a * (o.head<2>().squaredNorm() - radius * radius);
      if (discriminant < 0) continue;
      const double z = (-b - std::sqrt(discriminant)) / a;
      const Vector3 p = o + z * d;
      if (std::abs(p.z()) > 29.5) continue;  // near the caps
      if (-ray.normalized().dot(X.linear() * Vector3(p.x(), p.y(), 0) / radius) < std::cos(75 * deg)) continue;
      worst = std::max(worst, std::abs(c->depth_mm.at<float>(v, u) - z));
      ++checked;
    }
  }
  EXPECT_GT(checked, 1000);
  EXPECT_LT(worst, 0.01);
}

// A square plate before a wall: the shadow's borders on the wall follow from similar triangles.
TEST_P(EachRenderer, ThePlatesShadowLiesWhereGeometrySays) {
  const Camera camera = small_camera();
  const Vector3 projector(100, 10, -5);
  RenderScene scene;
  scene.objects.push_back({rectangle_mesh(60, 60, Surface{}), Pose(Eigen::Translation3d(0, 0, 700)), 1});
  scene.objects.push_back({rectangle_mesh(2000, 2000, Surface{}), Pose(Eigen::Translation3d(0, 0, 800)), 2});
  const auto c = renderer->render(scene, {camera, projector, 800, everything});
  int wrong = 0;
  double worst = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      if (c->instance.at<std::uint16_t>(v, u) != 2) continue;
      const Vector3 p = 800 * camera.ray(u, v);
      const Vector3 at_plate = projector + (p - projector) * (700 - projector.z()) / (800 - projector.z());
      const double inside = 30 - std::max(std::abs(at_plate.x()), std::abs(at_plate.y()));
      const float gap = c->projector_gap_mm.at<float>(v, u);
      if (std::abs(inside) < 1e-3) continue;  // on the border itself
      if ((gap > shadow_epsilon_mm) != (inside > 0)) ++wrong;
      if (inside > 0) worst = std::max(worst, std::abs(gap - (p - at_plate).norm()));
    }
  }
  // Exact up to a rim of a texel for the rasteriser.
  EXPECT_LE(wrong, GetParam() == "embree" ? 0 : 40);
  EXPECT_LT(worst, GetParam() == "embree" ? 1e-2 : 1e3);
}

// EFFECTS.md, paragraph IR, on a plane.
TEST_P(EachRenderer, LightFollowsItsFormula) {
  const Camera camera = small_camera();
  const Vector3 projector(100, 0, 0);
  const Surface surface{0.7f, 0.5f, 12.f, {1, 1, 1}, false};
  Pose X(Eigen::AngleAxisd(0.06, Vector3(0, 1, 0)));
  X.pretranslate(Vector3(0, 0, 750));
  RenderScene scene;
  scene.objects.push_back({rectangle_mesh(4000, 4000, surface), X, 1});
  const auto c = renderer->render(scene, {camera, projector, 820, everything});
  const Vector3 n = -X.linear().col(2);
  for (int v = 7; v < camera.height; v += 31) {
    for (int u = 5; u < camera.width; u += 29) {
      const Vector3 p = camera.ray(u, v) * c->depth_mm.at<float>(v, u);
      const Vector3 to_light = projector - p, l = to_light.normalized(), view = -p.normalized();
      const double diffuse = 0.7 * n.dot(l) * 820 * 820 / to_light.squaredNorm();
      const double specular = 0.5 * std::pow(std::max(0.0, (2 * n.dot(l) * n - l).dot(view)), 12);
      EXPECT_NEAR(c->diffuse.at<float>(v, u), diffuse, 2e-5);
      EXPECT_NEAR(c->specular.at<float>(v, u), specular, 2e-5);
      EXPECT_NEAR(c->ir.at<float>(v, u), diffuse + 0.5 * specular, 4e-5);
    }
  }
}

// -------------------------------------------------------------------------------------- against each other

class RandomWorld : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seeds, RandomWorld, testing::Range(0, 10));

TEST_P(RandomWorld, RasteriserAndRayCasterAgree) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const bool lens = GetParam() % 3 == 2;
  const Camera camera = lens ? lens_camera() : small_camera();
  const RenderScene scene = random_scene(seed, 12, lens ? 220 : 90);
  const RenderRequest request{camera, Vector3(GetParam() % 2 ? -90 : 100, 15, 0), 800, everything};
  const auto a = make_renderer("embree")->render(scene, request);
  const auto b = make_renderer("osmesa")->render(scene, request);

  // Which triangle is first may differ where two meet in a pixel: only there.
  cv::Mat differ = a->instance != b->instance;
  EXPECT_LE(count_if(differ & away_from_edges(*a, 1.5f) & away_from_edges(*b, 1.5f)),
            camera.width * camera.height / 1000);

  const cv::Mat same = ~differ, calm = same & away_from_edges(*a, 1.5f) & away_from_edges(*b, 1.5f) &
                                       (a->cos_incidence > std::cos(80 * deg));
  cv::Mat dz = cv::abs(a->depth_mm - b->depth_mm);
  // Where several triangles meet in a pixel (ridges are no depth edges), the rasteriser's may be the neighbour of the
  // ray's. With the lens, a pixel is 1.2 mm: nearly as wide as the facets of the round parts.
  EXPECT_LE(count_if((dz > 0.01) & calm), count_if(calm) / (lens ? 500 : 1000));

  cv::Mat shadow_a = a->projector_gap_mm > shadow_epsilon_mm, shadow_b = b->projector_gap_mm > shadow_epsilon_mm;
  // The rim: pixels beside a border of either mask.
  cv::Mat wide, narrow, rim = cv::Mat::zeros(shadow_a.size(), CV_8U);
  for (const cv::Mat& mask : {shadow_a, shadow_b}) {
    cv::dilate(mask, wide, cv::Mat());
    cv::erode(mask, narrow, cv::Mat());
    rim |= wide != narrow;
  }
  const cv::Mat compared = calm & ~rim;
  const int wrong = count_if((shadow_a != shadow_b) & compared);
  EXPECT_LE(wrong, count_if(compared) / 1000) << "of " << count_if(compared);
  EXPECT_GT(count_if(shadow_a), 300);
  EXPECT_LE(count_if((shadow_a != shadow_b) & same & rim), count_if(rim) / 3);
}

TEST(Renderer, EmptyScenesAndOnlyTheChannelsAskedFor) {
  for (const char* name : {"embree", "osmesa"}) {
    const auto renderer = make_renderer(name);
    const auto nothing = renderer->render(RenderScene{}, {small_camera(), Vector3(100, 0, 0), 800, everything});
    EXPECT_EQ(nothing->present(), everything);
    EXPECT_EQ(count_if(nothing->depth_mm), 0);
    EXPECT_EQ(count_if(nothing->cos_incidence), 0);
    const RenderScene scene = random_scene(1, 3, 60);
    for (std::uint32_t bit = 1; bit < everything; bit <<= 1) {
      const auto c = renderer->render(scene, {small_camera(), Vector3(100, 0, 0), 800, bit});
      EXPECT_EQ(c->present(), bit | static_cast<ChannelSet>(Channel::depth)) << name << " " << bit;
    }
    const auto dark = renderer->render(scene, {small_camera(), std::nullopt, 800, everything});
    EXPECT_TRUE(dark->projector_gap_mm.empty());
    EXPECT_FALSE(dark->ir.empty());
  }
}

TEST(Renderer, ThePlaneRendererAgreesWithATwoTrianglePlane) {
  RenderScene analytic;
  const Vector3 n = Vector3(0.3, -0.2, -1).normalized();
  analytic.plane = ScenePlane{n, n.dot(Vector3(0, 0, 800)), Surface{0.6f, 0.2f, 10.f, {1, 1, 1}, false}};
  RenderScene meshes;
  Pose X(Eigen::AngleAxisd(std::acos(n.z()), Vector3(-n.y(), n.x(), 0).normalized()));
  X.pretranslate(Vector3(0, 0, 800));
  meshes.objects.push_back({rectangle_mesh(9000, 9000, analytic.plane->surface), X, 1});
  for (const Camera& camera : {small_camera(), lens_camera()}) {
    const RenderRequest request{camera, Vector3(60, 0, 0), 800, everything};
    const auto a = make_renderer("plane")->render(analytic, request),
               b = make_renderer("embree")->render(meshes, request);
    EXPECT_LT(cv::norm(a->depth_mm, b->depth_mm, cv::NORM_INF), 1e-3);
    EXPECT_LT(cv::norm(a->ir, b->ir, cv::NORM_INF), 1e-5);
    EXPECT_LT(cv::norm(a->normal, b->normal, cv::NORM_INF), 1e-5);
    EXPECT_EQ(cv::norm(a->edge_px, b->edge_px, cv::NORM_INF), 0);
  }
}

TEST(Renderer, OpenAndInsideOutMeshesRenderAlikeFromBothSides) {
  const PartModel part = part_model("bracket");
  Mesh inverted = *part.mesh;
  for (auto& t : inverted.triangles) std::swap(t[1], t[2]);
  inverted.content_hash = hash_of(inverted);
  for (const char* name : {"embree", "osmesa"}) {
    RenderScene scene;
    Pose X(Eigen::AngleAxisd(0.8, Vector3(1, 2, 0).normalized()));
    X.pretranslate(Vector3(0, 0, 300));
    scene.objects.push_back({part.mesh, X, 1});
    const RenderRequest request{small_camera(), Vector3(50, 0, 0), 300, everything};
    const auto a = make_renderer(name)->render(scene, request);
    scene.objects[0].mesh = std::make_shared<const Mesh>(inverted);
    const auto b = make_renderer(name)->render(scene, request);
    EXPECT_LT(cv::norm(a->depth_mm, b->depth_mm, cv::NORM_INF), 1e-3) << name;
    EXPECT_LT(cv::norm(a->cos_incidence, b->cos_incidence, cv::NORM_INF), 1e-4) << name;
  }
}

// ------------------------------------------------------------------------------------------------ bad input

TEST(Renderer, ACameraInsideAPartIsRefusedUnlessItIsARoom) {
  for (const char* name : {"embree", "osmesa"}) {
    RenderScene scene;
    scene.objects.push_back({box_mesh({500, 500, 500}, Surface{}), Pose::Identity(), 1});
    RenderRequest request{small_camera(), Vector3(100, 0, 0), 250, everything};
    try {
      make_renderer(name)->render(scene, request);
      FAIL() << "rendered";
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("the camera is inside"));
    }
    request.check_inside = false;
    EXPECT_NEAR(make_renderer(name)->render(scene, request)->depth_mm.at<float>(120, 160), 250, 1e-3);
  }
}

TEST(Renderer, UnknownNamesAndUnfitScenesAreClearErrors) {
  try {
    make_renderer("embre");
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("did you mean embree"));
  }
  EXPECT_THROW(make_renderer("plane")->render(RenderScene{}, {small_camera(), {}, 800, everything}), Error);
  RenderScene scene = random_scene(1, 1, 10);
  scene.objects[0].X_CO.translation().x() = std::nan("");
  EXPECT_THROW(make_renderer("embree")->render(scene, {small_camera(), {}, 800, everything}), Error);
}

TEST(OffscreenGl, AShaderThatDoesNotCompileBringsTheDriversLog) {
  OffscreenGl gl;
  const OffscreenGl::Current current(gl);
  const std::string good = "#version 450 core\nvoid main() { gl_Position = vec4(0); }\n";
  try {
    OffscreenGl::program(good, "#version 450 core\nout vec4 c;\nvoid main() { c = nonsense; }\n");
    FAIL() << "compiled";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("fragment shader does not compile"));
    EXPECT_THAT(error.what(), testing::HasSubstr("nonsense"));
    EXPECT_THAT(error.what(), testing::HasSubstr("llvmpipe"));
  }
  EXPECT_THROW(
      OffscreenGl::program(good, "#version 450 core\nin vec3 nobody; out vec4 c;\nvoid main() { c = nobody.xyzz; }\n"),
      Error);
}

}  // namespace
}  // namespace binrig
