// Peak memory of recording, replaying and simulating does not grow with the number of frames: 100 against 10,000.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <functional>

#include <opencv2/core.hpp>

#include "app/open.h"
#include "core/random.h"
#include "core/recording_writer.h"
#include "sim/effect.h"
#include "sim/scene_forward_model.h"

namespace {

using namespace binrig;

Frame plane_frame(int number) {
  Frame frame;
  frame.camera = camera_from_field_of_view(64, 48, 0.3);
  frame.depth_scale_mm = 0.1;
  cv::Mat noise(48, 64, CV_32F);
  RandomStream(number).fill_normal(noise);
  frame.depth_mm.create(48, 64, CV_32F);
  for (int row = 0; row < 48; ++row) {
    for (int col = 0; col < 64; ++col) {
      frame.depth_mm.at<float>(row, col) = static_cast<float>(std::lround(8000 + 2 * noise.at<float>(row, col)) * 0.1);
    }
  }
  frame.reason = cv::Mat::zeros(48, 64, CV_8U);
  frame.time_s = number / 30.0;
  frame.sequence = number;
  return frame;
}

// Peak resident memory (MB) of `work` in a process of its own.
double peak_mb(const std::function<void()>& work) {
  std::fflush(stdout);
  const pid_t child = ::fork();
  if (child == 0) {
    work();
    ::_exit(0);
  }
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) std::fprintf(stderr, "the child failed\n");
  return usage.ru_maxrss / 1024.0;
}

void record(const std::string& path, int frames) {
  SetInfo info;
  info.sensor.name = "memory bench";
  info.sensor.frame_rate_hz = 30;
  RecordingWriter writer(path, info);
  CaptureInfo capture;
  capture.split = "train";
  capture.id = 1;
  capture.target = TargetKind::plane;
  writer.begin_capture(capture);
  for (int i = 0; i < frames; ++i) writer.write(plane_frame(i));
  writer.finish_capture();
}

void replay(const std::string& path) {
  const auto source = open_source("replay:" + path);
  source->start();
  while (source->next(std::chrono::seconds(1))) {
  }
}

void simulate(const std::string& path) {
  SceneOptions options;
  options.planes["train/1"] = {ScenePlane{}};
  const SceneForwardModel forward(RecordingSet::open(path), options);
  const SensorModel model = parse_sensor_model("name: bench\neffects:\n  - spectral_noise: {sigma: 0.2}\n", "bench", effect_catalogue());
  SimulationRequest request;
  request.model = &model;
  forward.simulate(request, [](const Frame&, int) {});
}

}  // namespace

int main() {
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("binrig-memory-" + std::to_string(::getpid()));
  std::printf("%-10s %14s %14s %8s\n", "peak MB", "100 frames", "10000 frames", "ratio");
  const std::string few = (folder / "few").string(), many = (folder / "many").string();
  const auto row = [](const char* name, double a, double b) { std::printf("%-10s %14.1f %14.1f %8.3f\n", name, a, b, b / a); };
  row("record", peak_mb([&] { record(few, 100); }), peak_mb([&] { record(many, 10000); }));
  row("replay", peak_mb([&] { replay(few); }), peak_mb([&] { replay(many); }));
  row("simulate", peak_mb([&] { simulate(few); }), peak_mb([&] { simulate(many); }));
  std::filesystem::remove_all(folder);
}
