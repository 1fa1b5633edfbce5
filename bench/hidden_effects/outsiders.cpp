// Effects that no catalogue has. Each has one amplitude; the rest is drawn.
#include <cmath>
#include <numbers>

#include <opencv2/core.hpp>

#include "bench/hidden_effects/shot.h"

namespace binrig::hidden {
namespace {

constexpr double pi = std::numbers::pi;

template <typename F>
Injection bias(F f) {
  return {Stage::geometry, [f](const Values& p, const Stand& stand) -> Act {
            return [f, p, stand](Shot& shot, Dice&) {
              shot.depth([&](double z, int v, int u) { return z + p.at("amplitude") * f(p, stand, shot, z, v, u); });
            };
          }};
}

std::map<std::string, Injection> table() {
  std::map<std::string, Injection> t;
  t["step_across_a_line"] = bias([](auto& p, auto&, const Shot& shot, double, int v, int u) {
    return std::cos(p.at("angle")) * shot.x(u) + std::sin(p.at("angle")) * shot.y(v) > p.at("place") ? 0.5 : -0.5;
  });
  t["spiral"] = bias([](auto& p, auto&, const Shot& shot, double, int v, int u) {
    return std::cos(3 * std::atan2(shot.y(v), shot.x(u)) + 12 * std::sqrt(shot.r2(v, u)) + p.at("phase"));
  });
  t["checkerboard"] = bias([](auto& p, auto&, auto&, double, int v, int u) {
    const int side = static_cast<int>(p.at("side"));
    return (u / side + v / side) % 2 ? 0.5 : -0.5;
  });
  t["moire"] = bias([](auto& p, const Stand& s, const Shot& shot, double z, int, int u) {
    return std::cos(2 * pi * 0.25 * s.focal_baseline / z + 9 * shot.x(u) + p.at("phase"));
  });
  t["corner_droop"] = bias([](auto&, auto&, const Shot& shot, double, int v, int u) {
    const double far = std::hypot(shot.x(u) - 1, shot.y(v) + 0.75);
    return std::pow(std::max(0.0, 1 - far / 0.9), 2);
  });
  t["bimodal_noise"] = {Stage::noise, [](const Values& p, const Stand&) -> Act {
                          return [a = p.at("amplitude")](Shot& shot, Dice& dice) {
                            shot.each([&](int v, int u) { shot.noise(v, u) += static_cast<float>(a * dice.sign()); });
                          };
                        }};
  t["noise_towards_the_bottom"] = {Stage::amplitude, [](const Values& p, const Stand&) -> Act {
                                     return [a = p.at("amplitude")](Shot& shot, Dice&) {
                                       for (int v = 0; v < shot.scale.rows; ++v)
                                         shot.scale.row(v) *= 1 + 2 * a * v / shot.scale.rows;
                                     };
                                   }};
  t["ring_of_holes"] = {Stage::device, [](const Values& p, const Stand&) -> Act {
                          return [a = p.at("amplitude")](Shot& shot, Dice& dice) {
                            shot.lose([&](int v, int u) {
                              const double r = std::sqrt(shot.r2(v, u));
                              return r > 0.45 && r < 0.6 && dice.uniform() < 0.5 * a;
                            });
                          };
                        }};
  return t;
}

}  // namespace

const std::map<std::string, Injection>& outside_injections() {
  static const auto t = table();
  return t;
}

}  // namespace binrig::hidden
