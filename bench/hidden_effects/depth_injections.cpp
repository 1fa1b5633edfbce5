// Where depth comes out: geometry and matching.
#include <cmath>
#include <numbers>

#include <opencv2/imgproc.hpp>

#include "bench/hidden_effects/shot.h"

namespace binrig::hidden {
namespace {

constexpr double pi = std::numbers::pi;

/// An effect that is a function of depth and place alone: f(values, stand) -> (z, v, u, shot) -> z'.
template <typename F>
Injection geometry(F f) {
  return {Stage::geometry, [f](const Values& p, const Stand& stand) -> Act {
            return [f, p, stand](Shot& shot, Dice&) {
              shot.depth([&](double z, int v, int u) { return f(p, stand, shot, z, v, u); });
            };
          }};
}

double intensity(const Channels& seen, int v, int u) { return std::max(0.01f, seen.ir.at<float>(v, u)); }

/// Least and largest depth among the pixels with depth in the square around one.
std::pair<float, float> range_around(const cv::Mat_<float>& z, const cv::Mat_<uchar>& hole, int v, int u, int half) {
  float low = z(v, u), high = low;
  for (int j = std::max(0, v - half); j <= std::min(z.rows - 1, v + half); ++j)
    for (int i = std::max(0, u - half); i <= std::min(z.cols - 1, u + half); ++i)
      if (!hole(j, i)) low = std::min(low, z(j, i)), high = std::max(high, z(j, i));
  return {low, high};
}

/// The whole instrument looks elsewhere or earlier: what is seen is replaced before anything else happens.
Injection other_view(double (*focal_factor)(const Values&), double (*delay_s)(const Values&)) {
  return {Stage::view, [=](const Values& p, const Stand& stand) -> Act {
            return [=](Shot& shot, Dice&) {
              shot.seen = stand.look(shot.number, shot.time_s - delay_s(p), focal_factor(p), nullptr, ~0u);
              shot.seen->depth_mm.copyTo(shot.z);
              shot.hole = shot.z <= 0;
              shot.hole /= 255;
            };
          }};
}

Act lateral_noise(const Values& p, const Stand&) {
  return [s = p.at("sigma")](Shot& shot, Dice& dice) {
    const cv::Mat_<float> before = shot.z.clone();
    shot.depth([&](float own, int v, int u) {
      const double y = std::clamp(v + s * dice.normal(), 0.0, before.rows - 1.001),
                   x = std::clamp(u + s * dice.normal(), 0.0, before.cols - 1.001);
      const int j = static_cast<int>(y), i = static_cast<int>(x);
      double low = 1e9, high = -1e9, mean = 0;
      bool all = true;
      for (int b = 0; b < 2; ++b)
        for (int a = 0; a < 2; ++a) {
          all &= !shot.hole(j + b, i + a);
          const double z = before(j + b, i + a);
          low = std::min(low, z), high = std::max(high, z);
          mean += z * (a ? x - i : 1 - x + i) * (b ? y - j : 1 - y + j);
        }
      if (all && high - low < 8) return static_cast<float>(mean);  // one surface
      const int n = static_cast<int>(std::lround(y)), m = static_cast<int>(std::lround(x));
      return shot.hole(n, m) ? own : before(n, m);
    });
  };
}

/// White noise through a Gaussian, on a field so much larger that its borders do not show.
Act bumps(const Values& p, const Stand& stand, Dice dice) {
  const double length = p.at("correlation_length");
  const int margin = static_cast<int>(3 * length) + 1;
  cv::Mat_<float> field(stand.camera.height + 2 * margin, stand.camera.width + 2 * margin);
  for (float& value : field) value = static_cast<float>(dice.normal());
  cv::GaussianBlur(field, field, {}, length);
  // The variance of white noise after that filter is that of its squared kernel's sum.
  const cv::Mat kernel = cv::getGaussianKernel(2 * margin + 1, length, CV_64F);
  const double variance = std::pow(kernel.dot(kernel), 2);
  const cv::Mat_<float> map = field(cv::Rect(margin, margin, stand.camera.width, stand.camera.height)) *
                              (p.at("amplitude") / std::sqrt(variance));
  return [map](Shot& shot, Dice&) { shot.depth([&](float z, int v, int u) { return z + map(v, u); }); };
}

std::map<std::string, Injection> table() {
  std::map<std::string, Injection> t;
  t["depth_scale"] = geometry([](auto& p, auto&, auto&, double z, int, int) { return z * (1 + p.at("scale")); });
  t["depth_offset"] = geometry([](auto& p, auto&, auto&, double z, int, int) { return z + p.at("offset"); });
  t["disparity_offset"] = geometry([](auto& p, const Stand& s, auto&, double z, int, int) {
    return s.focal_baseline / (s.focal_baseline / z + p.at("offset"));
  });
  t["focal_error"] =
      other_view([](const Values& p) { return 1 / (1 + p.at("error")); }, [](const Values&) { return 0.0; });
  t["latency"] = other_view([](const Values&) { return 1.0; }, [](const Values& p) { return p.at("delay"); });
  t["radial_distortion"] = geometry([](auto& p, const Stand& s, const Shot& shot, double z, int v, int u) {
    return s.focal_baseline / (s.focal_baseline / z + p.at("amplitude") * shot.r2(v, u));
  });
  t["depth_warp"] = geometry([](auto& p, const Stand& s, const Shot& shot, double z, int v, int u) {
    const double x = shot.x(u), y = shot.y(v);
    const double g = p.at("x_term") * x + p.at("y_term") * y + p.at("xx_term") * x * x + p.at("xy_term") * x * y +
                     p.at("yy_term") * y * y;
    return z * (1 + g * (z / s.z0 - 1));
  });
  t["depth_nonlinearity"] = geometry([](auto& p, const Stand& s, auto&, double z, int, int) {
    return z + p.at("amplitude") * std::pow((z - s.z0) / 100, 2);
  });
  t["column_banding"] = geometry([](auto& p, auto&, auto&, double z, int, int u) {
    return z + p.at("amplitude") * std::cos(2 * pi * u / p.at("period") + p.at("phase"));
  });
  t["row_banding"] = geometry([](auto& p, auto&, auto&, double z, int v, int) {
    return z + p.at("amplitude") * std::cos(2 * pi * v / p.at("period") + p.at("phase"));
  });
  t["pixel_locking"] = geometry([](auto& p, const Stand& s, auto&, double z, int, int) {
    const double d = s.focal_baseline / z;
    return s.focal_baseline / (d + p.at("amplitude") * std::sin(2 * pi * d + p.at("phase")));
  });
  t["tof_wiggling"] = geometry([](auto& p, auto&, auto&, double z, int, int) {
    return z + p.at("amplitude") * std::sin(4 * pi * z / p.at("wavelength") + p.at("phase"));
  });
  t["intensity_bias"] = geometry([](auto& p, auto&, const Shot& shot, double z, int v, int u) {
    return z + p.at("coefficient") * std::log(intensity(*shot.seen, v, u) / 0.4);
  });
  t["interreflection"] = geometry([](auto& p, auto&, const Shot& shot, double z, int v, int u) {
    return z + p.at("amplitude") * std::exp(-shot.seen->crease_px.template at<float>(v, u) / p.at("length"));
  });
  t["thermal_drift"] = geometry([](auto& p, const Stand& s, const Shot& shot, double z, int, int) {
    const double warmth =
        std::isinf(shot.since_power_on_s) ? 0 : std::exp(-shot.since_power_on_s / p.at("time_constant"));
    return s.focal_baseline / (s.focal_baseline / z + p.at("amplitude") * warmth);
  });
  t["fixed_pattern_noise"] = {Stage::geometry,
                              [](const Values& p, const Stand& s) { return bumps(p, s, s.unit_dice()); }};
  t["speckle_noise"] = {Stage::geometry,
                        [](const Values& p, const Stand& s) { return bumps(p, s, s.capture_dice()); }};

  t["edge_fattening"] = {Stage::matching, [](const Values& p, const Stand&) -> Act {
                           return [half = static_cast<int>(p.at("half_window"))](Shot& shot, Dice&) {
                             const cv::Mat_<float> before = shot.z.clone();
                             shot.depth([&](float z, int v, int u) {
                               return shot.seen->edge_px.at<float>(v, u) < half + 1.5
                                          ? range_around(before, shot.hole, v, u, half).first
                                          : z;
                             });
                           };
                         }};
  t["flying_pixels"] = {Stage::matching, [](const Values& p, const Stand&) -> Act {
                          return [p](Shot& shot, Dice& dice) {
                            const cv::Mat_<float> before = shot.z.clone();
                            shot.depth([&](float z, int v, int u) {
                              if (shot.seen->edge_px.at<float>(v, u) > p.at("width")) return z;
                              const auto [fore, back] = range_around(before, shot.hole, v, u, 3);
                              const bool hit = dice.uniform() < p.at("probability");
                              return hit ? static_cast<float>(dice.uniform(fore, back)) : z;
                            });
                          };
                        }};
  t["lateral_noise"] = {Stage::matching, lateral_noise};
  t["mismatch_outliers"] = {Stage::matching, [](const Values& p, const Stand&) -> Act {
                              return [p](Shot& shot, Dice& dice) {
                                shot.depth([&](double z, int, int) {
                                  const bool wrong = dice.uniform() < p.at("rate");
                                  return wrong ? z + dice.sign() * p.at("distance") : z;
                                });
                              };
                            }};
  t["specular_ghost"] = {Stage::matching, [](const Values& p, const Stand&) -> Act {
                           return [p](Shot& shot, Dice&) {
                             shot.depth([&](double z, int v, int u) {
                               const double specular = shot.seen->specular.at<float>(v, u);
                               return z + p.at("amplitude") * std::min(specular / p.at("scale"), 1.5);
                             });
                           };
                         }};
  return t;
}

}  // namespace

const std::map<std::string, Injection>& depth_injections() {
  static const auto t = table();
  return t;
}

}  // namespace binrig::hidden
