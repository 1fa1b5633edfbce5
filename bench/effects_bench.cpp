// What each effect costs on a 1280 x 960 frame, beside a copy of the depth image; and the thesis's five together.
//
//   effects_bench [name...]
//
// Median over repetitions of wall and CPU time (all threads), on the strong end of each effect's typical range. The
// frame is the tests' analytic scene: plane, box and sphere.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <set>
#include <vector>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "sim/sensor.h"
#include "tests/support/effect_run.h"

using namespace binrig;

namespace {

struct Cost {
  double wall_ms, cpu_ms;
};

/// Median over `repetitions` of body(); prepare() is not counted.
template <class Prepare, class Body>
Cost median_cost(int repetitions, const Prepare& prepare, const Body& body) {
  std::vector<double> wall, cpu;
  for (int i = 0; i <= repetitions; ++i) {
    prepare();
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t start_cpu = std::clock();
    body(i);
    const double cpu_ms = 1e3 * static_cast<double>(std::clock() - start_cpu) / CLOCKS_PER_SEC;
    if (i == 0) continue;  // first touch of memory, FFT plans
    wall.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
    cpu.push_back(cpu_ms);
  }
  std::nth_element(wall.begin(), wall.begin() + wall.size() / 2, wall.end());
  std::nth_element(cpu.begin(), cpu.begin() + cpu.size() / 2, cpu.end());
  return {wall[wall.size() / 2], cpu[cpu.size() / 2]};
}

EffectInstance strong(const Effect& effect) {
  if (effect.declaration.user_defined) {
    return parse_sensor_model(
               "effects:\n  - formula: {on: disparity, expression: \"a*r2 + b*sin(6.2832*d)\", parameters: {a: 0.1, b: "
               "0.02}}\n",
               "bench.yaml", effect_catalogue())
        .effects.at(0);
  }
  EffectInstance instance = test::make_instance(effect.declaration.name);
  instance.values.at(effect.declaration.amplitude).value = strength_value(effect.declaration, Strength::strong);
  return instance;
}

}  // namespace

int main(int argc, char** argv) {
  const std::set<std::string> only(argv + 1, argv + argc);
  for (const std::string& name : only)
    if (!effect_catalogue().find(name)) {
      std::fprintf(stderr, "effects_bench: there is no effect %s\n", name.c_str());
      return 2;
    }
  test::AnalyticScene scene = test::mixed_scene();
  const Camera camera = test::small_camera().resized(1280, 960);
  CaptureContext context = test::analytic_context(scene, camera);
  const auto channels = test::analytic_channels(scene, camera, context.projector_xyz_mm, 800);
  context.render = [&](const View&, int) { return channels; };  // rendering is not the effect's cost
  const Layers fresh = test::fresh_layers(*channels);
  Layers layers;
  const auto prepare = [&] {
    layers.depth_mm = fresh.depth_mm.clone();
    layers.sigma_scale = fresh.sigma_scale.clone();
    layers.noise_mm = fresh.noise_mm.clone();
    layers.reason = fresh.reason.clone();
    layers.ir = fresh.ir.clone();
  };

  cv::Mat copy;
  const Cost floor = median_cost(20, prepare, [&](int) { layers.depth_mm.copyTo(copy); });
  fmt::print("1280 x 960, {} threads; median of 15 frames\n\n{:<24}{:>10}{:>10}{:>16}\n", jobs(), "", "wall ms",
             "CPU ms", "x depth copy");
  fmt::print("{:<24}{:>10.2f}{:>10.2f}{:>16}\n", "(copy of the depth)", floor.wall_ms, floor.cpu_ms, 1);

  std::vector<double> all;
  for (const Effect* effect : all_effects()) {
    const std::string& name = effect->declaration.name;
    if (!only.empty() && !only.count(name)) continue;
    test::EffectUnderTest run(strong(*effect), context);
    const Cost cost = median_cost(15, prepare, [&](int i) { run.apply(layers, *channels, i); });
    all.push_back(cost.wall_ms);
    fmt::print("{:<24}{:>10.2f}{:>10.2f}{:>16.1f}\n", name, cost.wall_ms, cost.cpu_ms, cost.wall_ms / floor.wall_ms);
    std::fflush(stdout);
  }
  std::sort(all.begin(), all.end());
  if (!all.empty()) {
    fmt::print("\n{} effects: median {:.2f} ms, slowest {:.2f} ms\n", all.size(), all[all.size() / 2], all.back());
  }

  if (only.empty()) {
    SensorModel model;
    for (const char* name :
         {"projector_shadow", "specular_saturation", "low_confidence", "spectral_noise", "bilateral_blur"}) {
      model.effects.push_back(test::make_instance(name));
    }
    model.effects.back().values.at("diameter").value = 7;
    check_sensor_model(model, effect_catalogue());
    SensorRun run(model, context);
    const Cost five = median_cost(
        15, [] {},
        [&](int i) {
          run.frame(*channels, FrameInstant{i, 0.1 * i});
        });
    model.effects.clear();
    SensorRun none(model, context);
    const Cost empty = median_cost(
        15, [] {},
        [&](int i) {
          none.frame(*channels, FrameInstant{i, 0.1 * i});
        });
    fmt::print(
        "the thesis's five together (7 x 7 blur), whole frame: {:.1f} ms wall, {:.1f} ms CPU; of which layers and "
        "storage {:.1f} ms\n",
        five.wall_ms, five.cpu_ms, empty.wall_ms);
  }
}
