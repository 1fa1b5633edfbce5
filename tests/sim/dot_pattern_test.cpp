// The first-principles instrument: what must come of itself does.
#include "sim/dot_pattern/instrument.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "core/random.h"
#include "sim/dot_pattern/matcher.h"

namespace binrig::dot_pattern {
namespace {

constexpr double warm = std::numeric_limits<double>::infinity();

using Numbers = std::map<std::string, double>;

SensorModel instrument_model(const Numbers& numbers = {}, const std::map<std::string, std::string>& words = {}) {
  SensorModel model;
  model.name = "under test";
  model.dot_pattern = true;
  model.instrument = numbers;
  model.instrument_options = words;
  return model;
}

// 160 x 120, f = 567 px, the second view at 100 mm: 11.3 mm a pixel of disparity at 800 mm.
Geometry small_geometry() {
  Geometry geometry;
  geometry.nominal = geometry.actual = camera_from_field_of_view(160, 120, 16.06 * std::numbers::pi / 180);
  return geometry;
}

// A plane through (0, 0, z), turned about the vertical axis.
RenderScene plane_at(double z_mm, double tilt_rad = 0, float albedo = 0.6f) {
  ScenePlane plane;
  plane.normal = Vector3(std::sin(tilt_rad), 0, -std::cos(tilt_rad));
  plane.offset_mm = -z_mm * std::cos(tilt_rad);
  plane.surface.albedo = albedo;
  RenderScene scene;
  scene.plane = plane;
  return scene;
}

SceneObject placed(std::shared_ptr<const Mesh> mesh, const Vector3& place_mm) {
  SceneObject object;
  object.mesh = std::move(mesh);
  object.X_CO.translation() = place_mm;
  return object;
}

double plane_depth(const RenderScene& scene, const Camera& camera, int u, int v) {
  return scene.plane->offset_mm / scene.plane->normal.dot(camera.ray(u, v));
}

double share_with(const Frame& frame, Reason reason, cv::Rect where) {
  const cv::Mat found = frame.reason(where) == static_cast<int>(reason);
  return cv::countNonZero(found) / static_cast<double>(where.area());
}

// Median of depth minus the plane's, over valid pixels, in pixels of disparity (nearer is positive).
std::vector<double> disparity_errors(const Frame& frame, const RenderScene& scene, const Geometry& geometry) {
  std::vector<double> errors;
  for (int v = 0; v < frame.depth_mm.rows; ++v) {
    for (int u = 0; u < frame.depth_mm.cols; ++u) {
      const double z = frame.depth_mm.at<float>(v, u);
      if (z <= 0) continue;
      const double fb = geometry.nominal.fx * geometry.second_view_mm.x();
      errors.push_back(fb / z - fb / plane_depth(scene, geometry.nominal, u, v));
    }
  }
  return errors;
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// Steps of 1/16 px and locking of a parabola (below 0.1 px with these dots) are the whole error of a clean instrument.
TEST(DotPattern, MeasuresAPlaneByEitherPrincipleAndCost) {
  const auto renderer = make_renderer("plane");
  for (const char* principle : {"structured_light", "active_stereo"}) {
    for (const char* cost : {"zncc", "census"}) {
      for (double side : {1.0, -1.0}) {
        SCOPED_TRACE(std::string(principle) + " " + cost + (side > 0 ? " +x" : " -x"));
        Geometry geometry = small_geometry();
        geometry.second_view_mm.x() *= side;
        const RenderScene scene = plane_at(800, 0.3);
        Instrument instrument(instrument_model({}, {{"principle", principle}, {"cost", cost}}), geometry, *renderer);
        const Frame frame = instrument.frame(scene, 0, warm);
        frame.check("frame");
        const std::vector<double> errors = disparity_errors(frame, scene, geometry);
        EXPECT_GT(errors.size(), 0.6 * 160 * 120);
        EXPECT_LT(std::abs(median(errors)), 0.03);
        EXPECT_LT(*std::max_element(errors.begin(), errors.end()), 0.3);
        EXPECT_GT(*std::min_element(errors.begin(), errors.end()), -0.3);
      }
    }
  }
}

TEST(DotPattern, SameSeedSameBytesWhateverTheThreads) {
  const auto renderer = make_renderer("plane");
  const Geometry geometry = small_geometry();
  const auto frame_with = [&](int threads, std::uint64_t seed) {
    Geometry seeded = geometry;
    seeded.seed = seed;
    set_jobs(threads);
    Instrument instrument(instrument_model(), seeded, *renderer);
    const Frame frame = instrument.frame(plane_at(800, 0.2), 3, warm);
    set_jobs(0);
    return frame;
  };
  const Frame one = frame_with(1, 1);
  EXPECT_EQ(difference(one, frame_with(3, 1)), "");
  EXPECT_NE(difference(one, frame_with(3, 2)), "");
}

TEST(DotPattern, EveryBadKeyIsNamedAtOnce) {
  const auto renderer = make_renderer("plane");
  SensorModel model =
      instrument_model({{"windw", 9}, {"bits", 30}, {"binning", 1.5}, {"window", 8}}, {{"cost", "sad"}});
  model.file = "somewhere.yaml";
  try {
    Instrument instrument(model, small_geometry(), *renderer);
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.violations().size(), 5u);
    EXPECT_THAT(error.what(), testing::HasSubstr("did you mean window?"));
    EXPECT_THAT(error.what(), testing::HasSubstr("somewhere.yaml"));
    EXPECT_THAT(error.what(), testing::HasSubstr("6 .. 12"));
    EXPECT_THAT(error.what(), testing::HasSubstr("zncc, census"));
  }
}

TEST(DotPattern, TheWholeTableRoundTripsThroughItsInitialValues) {
  SensorModel model = instrument_model();
  const Parameters clean;
  for (const ParameterRow& row : parameter_table()) {
    model.instrument[row.name] = clean.*(row.member);
    EXPECT_FALSE(row.meaning.empty()) << row.name;
  }
  EXPECT_NO_THROW(read_parameters(model));
}

}  // namespace
}  // namespace binrig::dot_pattern
