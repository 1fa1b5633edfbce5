// Time of fitting and of making noise. `bytes_per_second` of the copy and `copies` of the synthesis say what it costs
// in plain memory copies of a frame.
#include <chrono>
#include <cstring>

#include <benchmark/benchmark.h>
#include <opencv2/core.hpp>

#include "calib/noise_fit.h"
#include "core/random.h"
#include "core/spectrum.h"

namespace {

using namespace binrig;

double copy_seconds(const cv::Mat& image) {
  cv::Mat other(image.size(), image.type());
  const std::clock_t start = std::clock();
  constexpr int rounds = 200;
  for (int i = 0; i < rounds; ++i) {
    std::memcpy(other.data, image.data, image.total() * image.elemSize());
    benchmark::DoNotOptimize(other.data);
    benchmark::ClobberMemory();
  }
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC / rounds;
}

void copy_of_a_frame(benchmark::State& state) {
  const cv::Mat image = cv::Mat::ones(960, 1280, CV_32F);
  cv::Mat other(image.size(), CV_32F);
  for (auto _ : state) {
    std::memcpy(other.data, image.data, image.total() * 4);
    benchmark::DoNotOptimize(other.data);
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * 960 * 1280 * 4);
}
BENCHMARK(copy_of_a_frame)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);

void synthesise_1280x960(benchmark::State& state) {
  // As fitted on 640 x 480 and resampled.
  const auto spectrum = NoiseSpectrum::parametric(480, 640, 0.3, 1.0, 0.1).resampled(960, 1280);
  const NoiseSynthesis synthesis(spectrum, state.range(0) == 1);
  cv::Mat noise;
  std::uint64_t frame = 0;
  const std::clock_t start = std::clock();
  for (auto _ : state) synthesis.synthesise(RandomStream(++frame), noise);
  const double each =
      static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC / static_cast<double>(state.iterations());
  state.counters["copies"] = each / copy_seconds(noise);
}
BENCHMARK(synthesise_1280x960)
    ->ArgName("rayleigh")
    ->Arg(0)
    ->Arg(1)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

void fit_40_frames_640x480(benchmark::State& state) {
  const Camera camera = camera_from_field_of_view(640, 480, 0.6);
  const PixelRays rays(camera);
  PlaneFit plane;
  plane.normal = Vector3(0.2, 0, -std::sqrt(0.96));
  plane.offset_mm = plane.normal.z() * 800;
  const cv::Mat perfect = plane.perfect_depth(rays);
  const NoiseSynthesis noise(NoiseSpectrum::parametric(480, 640, 0.3, 1.0, 0.1));
  std::vector<Frame> frames(40);
  for (int i = 0; i < 40; ++i) {
    cv::Mat field;
    noise.synthesise(RandomStream(i), field);
    frames[i].camera = camera;
    frames[i].depth_scale_mm = 0.02;
    frames[i].depth_mm = perfect + field;
    frames[i].reason = cv::Mat::zeros(480, 640, CV_8U);
  }
  const FrameStream stream = [&](const FrameSink& sink) {
    for (int i = 0; i < 40; ++i) sink(frames[i], i);
  };
  for (auto _ : state) {
    const FirstLook look = look_at("train/1", "", frames[0], 40, {});
    const LowFrequencies low = choose_drop_order({look.order_powers}, {look.plane.rms_z_mm});
    PlaneNoiseOptions options;
    options.drop_order = low.drop_order;
    const FittedNoise fit = fit_noise({measure_noise(look, stream, false, options)}, low, true);
    benchmark::DoNotOptimize(fit.sigma_mm);
  }
}
BENCHMARK(fit_40_frames_640x480)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond)->Iterations(2);

}  // namespace

BENCHMARK_MAIN();
