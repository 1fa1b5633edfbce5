// The first-principles instrument at 640 x 480: a frame of a new scene (rendered, exposed, matched), a further frame of
// the same scene (noise and matching alone), and the matcher by itself. Budget: 1 s a frame on 2 cores.
#include <benchmark/benchmark.h>

#include <limits>
#include <numbers>

#include "sim/dot_pattern/instrument.h"
#include "sim/part_models.h"

namespace {

using namespace binrig;

SensorModel instrument_model(bool active, bool census) {
  SensorModel model;
  model.name = "bench";
  model.dot_pattern = true;
  if (active) model.instrument_options["principle"] = "active_stereo";
  if (census) model.instrument_options["cost"] = "census";
  return model;
}

RenderScene bin_of_parts(double shift_mm) {
  RenderScene scene;
  const auto add = [&](std::shared_ptr<const Mesh> mesh, double x, double y, double z) {
    SceneObject object;
    object.mesh = std::move(mesh);
    object.X_CO.translation() = Vector3(x, y, z);
    scene.objects.push_back(object);
  };
  static const auto floor = rectangle_mesh(800, 800, {}), bracket = part_model("bracket").mesh;
  add(floor, 0, 0, 870);
  for (int i = 0; i < 12; ++i) add(bracket, 50 * (i % 4) - 75 + shift_mm, 45 * (i / 4) - 45, 840);
  return scene;
}

void frames(benchmark::State& state, bool active, bool census, bool still) {
  dot_pattern::Geometry geometry;
  geometry.nominal = geometry.actual = camera_from_field_of_view(640, 480, 16.06 * std::numbers::pi / 180);
  const auto renderer = make_renderer();
  dot_pattern::Instrument instrument(instrument_model(active, census), geometry, *renderer);
  const double warm = std::numeric_limits<double>::infinity();
  int number = 0;
  instrument.frame(bin_of_parts(0), number++, warm);
  for (auto _ : state) {
    benchmark::DoNotOptimize(instrument.frame(bin_of_parts(still ? 0 : number % 7), number, warm));
    ++number;
  }
}

BENCHMARK_CAPTURE(frames, new_scene, false, false, false)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(frames, same_scene, false, false, true)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(frames, new_scene_active_stereo, true, false, false)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK_CAPTURE(frames, new_scene_census, false, true, false)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
