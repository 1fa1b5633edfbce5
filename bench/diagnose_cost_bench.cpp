// What a diagnosis is made of, and how its cost grows: reading simulated recordings, by number of frames, and asking
// what each effect of the catalogue would change, by number of effects. Both must be straight lines (the fit of
// `BigO`, by frames and by signatures); per_frame and per_effect say the slope (CPU time).
#include <algorithm>
#include <filesystem>
#include <numeric>

#include <benchmark/benchmark.h>

#include "bench/support/campaign.h"
#include "bench/support/small_campaign.h"
#include "core/error.h"
#include "diagnose/signatures.h"
#include "sim/effect.h"

namespace binrig {
namespace {

/// Four planes, each seen in so many frames.
class Planes {
 public:
  explicit Planes(int frames) {
    std::string name = (std::filesystem::temp_directory_path() / "diagnose-cost-XXXXXX").string();
    if (!mkdtemp(name.data())) throw Error("no scratch folder can be made at " + name);
    folder_ = name;
    bench::Campaign campaign(1);
    for (const double z : {700.0, 760.0, 820.0, 880.0}) campaign.plane("train", "plane", frames, z);
    bench::write_nominal(folder_ / "set", bench::campaign_sensor(), camera_from_field_of_view(128, 96, 0.28), 0.02,
                         campaign.models(), campaign.captures());
    forward_ = std::make_unique<SceneForwardModel>(RecordingSet::open(folder_ / "set"));
  }
  ~Planes() {
    forward_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  const SceneForwardModel& forward() const { return *forward_; }

 private:
  std::filesystem::path folder_;
  std::unique_ptr<SceneForwardModel> forward_;
};

void read_simulations(benchmark::State& state) {
  const int frames = static_cast<int>(state.range(0));
  const Planes planes(frames);
  SimulationCache cache("");
  const SensorModel model = bench::five_effect_model();
  const Experiment experiment(planes.forward(), model, cache);
  std::uint64_t seed = 1;
  for (auto _ : state) benchmark::DoNotOptimize(experiment.simulate({{model, {}, seed++}}));
  state.SetComplexityN(4 * frames);
  state.counters["per_frame"] =
      benchmark::Counter(4.0 * frames, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(read_simulations)
    ->RangeMultiplier(2)
    ->Range(4, 64)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond)
    ->Complexity(benchmark::oN);

void ask_effects(benchmark::State& state) {
  static const bench::SmallCampaign campaign(true);
  SimulationCache cache("");
  const SensorModel model = bench::five_effect_model();
  const Experiment experiment(campaign.forward(), model, cache);
  const Hypotheses all = make_hypotheses(campaign.forward(), model);
  // Every k-th of the catalogue: neighbours in the alphabet are alike.
  const int count = std::min<int>(static_cast<int>(state.range(0)), static_cast<int>(all.tested.size()));
  std::vector<int> some(count);
  for (int k = 0; k < count; ++k) some[k] = k * static_cast<int>(all.tested.size()) / count;
  std::size_t signatures = 0;
  for (auto _ : state) {
    SignatureBook book(experiment, model, all, {});
    book.look_at(some, false);
    signatures = book.signatures().size();
  }
  state.SetComplexityN(static_cast<long>(signatures));
  state.counters["effects"] = count;
  state.counters["signatures"] = static_cast<double>(signatures);
  state.counters["per_effect"] =
      benchmark::Counter(count, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(ask_effects)
    ->Arg(5)
    ->Arg(10)
    ->Arg(20)
    ->Arg(60)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond)
    ->Complexity(benchmark::oN);

}  // namespace
}  // namespace binrig

BENCHMARK_MAIN();
