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
#include "sim/dot_pattern/pattern.h"

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

// Standard deviation in time, mm, over the pixels that are always valid.
double temporal_sigma_mm(Instrument& instrument, const RenderScene& scene, int frames) {
  cv::Mat sum, squares, always;
  for (int i = 0; i < frames; ++i) {
    const Frame frame = instrument.frame(scene, i, warm);
    cv::Mat depth;
    frame.depth_mm.convertTo(depth, CV_64F);
    const cv::Mat valid = frame.reason == 0;
    sum = i ? cv::Mat(sum + depth) : depth.clone();
    squares = i ? cv::Mat(squares + depth.mul(depth)) : depth.mul(depth);
    always = i ? cv::Mat(always & valid) : valid.clone();
  }
  const cv::Mat variance = (squares - sum.mul(sum) / frames) / (frames - 1);
  return std::sqrt(cv::mean(variance, always)[0]);
}

// Slope of log sigma over log distance; the plane is tilted so that every fraction of a pixel occurs.
double noise_exponent(bool even_light) {
  const auto renderer = make_renderer("plane");
  double mx = 0, my = 0, xx = 0, xy = 0;
  const std::vector<double> distances{500, 700, 1000, 1400};
  for (double z : distances) {
    Geometry geometry = small_geometry();
    geometry.range_mm = {0.85 * z, 1.2 * z};
    const double exposure = even_light ? 0.3 * z * z / (800.0 * 800.0) : 0.3;
    Instrument instrument(instrument_model({{"disparity_step", 0}, {"exposure", exposure}, {"ambient", 0}}), geometry,
                          *renderer);
    const double x = std::log(z), y = std::log(temporal_sigma_mm(instrument, plane_at(z, 0.3), 6));
    mx += x, my += y, xx += x * x, xy += x * y;
  }
  const double n = static_cast<double>(distances.size());
  return (xy - mx * my / n) / (xx - mx * mx / n);
}

// sigma_z = z^2 s / (f B) with s the same at every distance where the image is equally bright. 130 windows that do not
// overlap and 5 degrees of freedom each give sigma to 3 % and the slope over a factor 2.8 to 0.04; the light's
// obliquity (100 mm beside 500 mm) adds 0.04.
TEST(DotPattern, NoiseGrowsWithTheSquareOfDistanceInEvenLight) { EXPECT_NEAR(noise_exponent(true), 2.0, 0.15); }

// With the light of one exposure photons fall as 1 / z^2, too: s grows as z where photons make the noise and as z^2
// where the read noise does, so the exponent lies between 3 and 4.
TEST(DotPattern, NoiseGrowsWithTheThirdPowerInOneExposure) {
  const double exponent = noise_exponent(false);
  EXPECT_GT(exponent, 2.85);
  EXPECT_LT(exponent, 4.0);
}

// Shimizu and Okutomi, "Sub-pixel estimation error cancellation on area-based matching", IJCV 63(3), 2005: a parabola
// through three likenesses errs with the period of a pixel, not at all at whole and half pixels, towards the whole ones
// between. Averages over 2400 pixels (20 windows) a bin know the error to about 0.004 px.
TEST(DotPattern, PixelLockingHasThePublishedShape) {
  const auto renderer = make_renderer("plane");
  for (const char* cost : {"zncc", "census"}) {
    SCOPED_TRACE(cost);
    Geometry geometry;
    geometry.nominal = geometry.actual = camera_from_field_of_view(320, 240, 16.06 * std::numbers::pi / 180);
    geometry.range_mm = {650, 1000};
    const RenderScene scene = plane_at(800, 0.5);
    Instrument instrument(instrument_model({{"disparity_step", 0}}, {{"cost", cost}}), geometry, *renderer);
    const Frame frame = instrument.frame(scene, 0, warm);
    constexpr int bins = 16;
    double sum[2][bins] = {}, count[2][bins] = {};
    const double fb = geometry.nominal.fx * 100;
    for (int v = 0; v < 240; ++v) {
      for (int u = 0; u < 320; ++u) {
        const double z = frame.depth_mm.at<float>(v, u);
        if (z <= 0) continue;
        const double truth = fb / plane_depth(scene, geometry.nominal, u, v);
        const int bin = static_cast<int>((truth - std::floor(truth)) * bins);
        sum[u < 160][bin] += fb / z - truth;
        count[u < 160][bin] += 1;
      }
    }
    double sine = 0, cosine = 0, power = 0, product = 0, powers[2] = {};
    for (int i = 0; i < bins; ++i) {
      const double a = sum[0][i] / count[0][i], b = sum[1][i] / count[1][i],
                   phase = 2 * std::numbers::pi * (i + 0.5) / bins;
      sine += (a + b) / bins * std::sin(phase), cosine += (a + b) / bins * std::cos(phase);
      power += (a + b) * (a + b) / 4 / bins;
      product += a * b, powers[0] += a * a, powers[1] += b * b;
    }
    EXPECT_LT(sine, -0.02) << "towards whole pixels";
    EXPECT_GT(sine, -0.2);
    EXPECT_LT(std::abs(cosine), 0.2 * std::abs(sine)) << "odd about whole and half pixels";
    EXPECT_GT(sine * sine / 2 / power, 0.9) << "nearly a sine";
    EXPECT_GT(product / std::sqrt(powers[0] * powers[1]), 0.95) << "the same in every pixel of disparity";
  }
}

// A board 100 mm before a wall throws a shadow of f B (1/750 - 1/850) = 8.9 px, on the side away from the projector.
TEST(DotPattern, ShadowLiesOnTheBaselinesSide) {
  const auto renderer = make_renderer();
  RenderScene scene;
  scene.objects = {placed(rectangle_mesh(800, 800, {}), {0, 0, 850}), placed(rectangle_mesh(80, 100, {}), {0, 0, 750})};
  const double f = small_geometry().nominal.fx;
  const int left = static_cast<int>(79.5 - 40 * f / 750), right = static_cast<int>(79.5 + 40 * f / 750) + 1;
  for (double side : {1.0, -1.0}) {
    Geometry geometry = small_geometry();
    geometry.second_view_mm.x() = 100 * side;
    Instrument instrument(instrument_model(), geometry, *renderer);
    const Frame frame = instrument.frame(scene, 0, warm);
    const cv::Rect beside_left(left - 8, 45, 7, 30), beside_right(right + 1, 45, 7, 30);
    const double lit = share_with(frame, Reason::measured, side > 0 ? beside_right : beside_left);
    const double dark = share_with(frame, Reason::measured, side > 0 ? beside_left : beside_right);
    // Windows of 11 px reach over both edges of the shadow, so that up to half of it is filled from either side.
    EXPECT_GT(lit, 0.75) << side;
    EXPECT_LT(dark, 0.6) << side;
    EXPECT_LT(dark, lit - 0.3) << side;
  }
}

TEST(DotPattern, DarkSurfacesDropOutAndGlaringOnesAreFull) {
  const auto renderer = make_renderer();
  RenderScene scene;
  Surface dark, bright;
  dark.albedo = 0.004f, bright.albedo = 0.6f;
  scene.objects = {placed(rectangle_mesh(200, 300, dark), {-100, 0, 800}),
                   placed(rectangle_mesh(200, 300, bright), {100, 0, 800})};
  const cv::Rect dark_half(10, 10, 60, 100), bright_half(90, 10, 60, 100);
  Instrument normal(instrument_model({{"exposure", 0.3}}), small_geometry(), *renderer);
  const Frame frame = normal.frame(scene, 0, warm);
  EXPECT_GT(share_with(frame, Reason::low_signal, dark_half), 0.9);
  EXPECT_EQ(share_with(frame, Reason::measured, bright_half), 1);
  Instrument glaring(instrument_model({{"exposure", 60}}), small_geometry(), *renderer);
  EXPECT_GT(share_with(glaring.frame(scene, 0, warm), Reason::saturated, bright_half), 0.9);
}

// The median over the image of what an imperfection adds to the disparity, against the clean instrument with the same
// draws; locking differs between the two by up to 0.04 px, which a tilted plane averages to under 0.01.
double added_disparity(const Numbers& numbers, double since_power_on_s = warm) {
  const auto renderer = make_renderer("plane");
  const Geometry geometry = small_geometry();
  const RenderScene scene = plane_at(800, 0.3);
  Numbers all = numbers;
  all["disparity_step"] = 0;
  Instrument clean(instrument_model({{"disparity_step", 0}}), geometry, *renderer),
      other(instrument_model(all), geometry, *renderer);
  return median(disparity_errors(other.frame(scene, 0, since_power_on_s), scene, geometry)) -
         median(disparity_errors(clean.frame(scene, 0, warm), scene, geometry));
}

TEST(DotPattern, GeometryErrorsShiftTheDisparityAsTheyMust) {
  const double f = small_geometry().nominal.fx;
  EXPECT_NEAR(added_disparity({{"yaw_error", 0.001}}), f * 0.001, 0.03);
  EXPECT_NEAR(added_disparity({{"baseline_error", 0.5}}), f * 0.5 / 800, 0.03);
  const Numbers drift{{"yaw_drift", 0.002}, {"drift_time", 30}};
  EXPECT_NEAR(added_disparity(drift, 0), f * 0.002, 0.03);
  EXPECT_NEAR(added_disparity(drift, 45), f * 0.002 * std::exp(-1.5), 0.03);
  EXPECT_NEAR(added_disparity(drift), 0, 1e-6) << "a warm device does not drift";
}

TEST(DotPattern, DustAndDeadPixelsMakeHoles) {
  const auto renderer = make_renderer("plane");
  const Geometry geometry = small_geometry();
  Instrument dusty(instrument_model({{"dust_x", 0.25}, {"dust_radius", 9}, {"dust_opacity", 1}}), geometry, *renderer);
  const Frame frame = dusty.frame(plane_at(800), 0, warm);
  EXPECT_LT(share_with(frame, Reason::measured, cv::Rect(98, 58, 4, 4)), 0.01);  // 79.5 + 0.25 * 80 = 99.5
  EXPECT_EQ(share_with(frame, Reason::measured, cv::Rect(20, 20, 40, 80)), 1);
  Instrument dying(instrument_model({{"dead_pixels", 0.05}}), geometry, *renderer);
  const Frame broken = dying.frame(plane_at(800), 0, warm);
  EXPECT_LT(share_with(broken, Reason::measured, cv::Rect(20, 20, 120, 80)), 0.999);
}

// Blending images with a share of a leaves noise a / (2 - a) of its variance: 0.25 for 0.4, so half of sigma.
TEST(DotPattern, ALaggingSensorIsQuieter) {
  const auto renderer = make_renderer("plane");
  const auto sigma = [&](double blend) {
    Instrument instrument(instrument_model({{"disparity_step", 0}, {"frame_blend", blend}}), small_geometry(),
                          *renderer);
    for (int i = 0; i < 6; ++i) instrument.frame(plane_at(800, 0.3), i, warm);
    double difference = 0;
    Frame last = instrument.frame(plane_at(800, 0.3), 6, warm);
    for (int i = 7; i < 9; ++i) {
      const Frame next = instrument.frame(plane_at(800, 0.3), i, warm);
      difference += cv::mean((next.depth_mm - last.depth_mm).mul(next.depth_mm - last.depth_mm))[0];
      last = next;
    }
    return std::sqrt(difference);
  };
  // Successive differences of the blend: a^2 of the new image's variance plus what decays, 2 a^2 / (2 - a) against 2.
  EXPECT_NEAR(sigma(0.4) / sigma(1.0), 0.4 / std::sqrt(2 - 0.4), 0.08);
}

// Images that are each other's shift by whole pixels: the disparity is that shift, and the border is named.
TEST(DotPatternMatcher, FindsWholeShiftsExactly) {
  cv::Mat noise(60, 120, CV_32F), texture;
  RandomStream(5).fill_uniform(noise);
  noise.convertTo(texture, CV_16U, 1000);
  const cv::Mat left = texture(cv::Rect(20, 0, 80, 60)).clone(), right = texture(cv::Rect(13, 0, 80, 60)).clone();
  for (Cost cost : {Cost::zncc, Cost::census}) {
    MatchSettings settings;
    settings.cost = cost;
    settings.window_px = 9;
    settings.lowest_px = -12, settings.highest_px = 4;
    settings.disparity_step_px = 0.5;
    const Matches matches = match_blocks(left, right, 0, settings);
    int found = 0;
    for (int v = 8; v < 52; ++v) {
      for (int u = 8; u < 65; ++u) {
        if (matches.reason.at<std::uint8_t>(v, u) != 0) continue;
        ++found;
        ASSERT_EQ(matches.disparity_px.at<float>(v, u), -7.f) << u << " " << v;
      }
    }
    EXPECT_EQ(found, 44 * 57);
    EXPECT_EQ(matches.reason.at<std::uint8_t>(30, 77), static_cast<int>(Reason::border));
    EXPECT_EQ(matches.reason.at<std::uint8_t>(2, 30), static_cast<int>(Reason::border));
  }
}

TEST(DotPatternMatcher, RefusesImagesThatDoNotFit) {
  const cv::Mat image = cv::Mat::zeros(40, 60, CV_16U);
  EXPECT_THROW(match_blocks(image, cv::Mat::zeros(39, 60, CV_16U), 0, {}), Error);
  EXPECT_THROW(match_blocks(cv::Mat::zeros(40, 60, CV_8U), image, 0, {}), Error);
  EXPECT_THROW(match_blocks(image(cv::Rect(0, 0, 10, 10)), image(cv::Rect(0, 0, 10, 10)), 0, {}), Error);
}

// Windows of the pattern look like no other window that the matcher might try: below 0.6 against 1.
TEST(DotPatternMatcher, ThePatternIsUniqueAlongEpipolarLines) {
  const Parameters parameters;
  const Pattern pattern(parameters, 0, 400, 60);
  const cv::Mat image = pattern.image(0, 400, 60, parameters.optics_sigma, 1000);
  MatchSettings settings;
  settings.lowest_px = -150, settings.highest_px = 150;
  settings.uniqueness = 0.3;
  settings.min_correlation = 0.99;
  const Matches matches = match_blocks(image, image, 0, settings);
  const cv::Rect inside(160, 10, 80, 40);
  const cv::Mat found = matches.reason(inside) == 0;
  EXPECT_GT(cv::countNonZero(found), 0.99 * inside.area());
}

}  // namespace
}  // namespace binrig::dot_pattern
