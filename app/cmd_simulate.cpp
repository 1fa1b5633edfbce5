// binrig simulate: a world through a sensor model into a BOP dataset.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/recording_writer.h"
#include "sim/bop_extras.h"
#include "sim/effect.h"
#include "sim/synthetic_source.h"

namespace binrig {
namespace {

struct SimulateOptions {
  std::string world, model, out, split = "test";
  int scenes = 1, frames = 1;
  bool no_rgb = false, no_masks = false;
  CommonOptions common;
};

SensorModel model_of(const WorldSensor& sensor, const SimulateOptions& options) {
  const std::string file = options.model.empty() ? sensor.model_file : options.model;
  if (file.empty()) {
    throw Error(options.world + ": the sensor " + sensor.name + " has no model: write one there, or give --model");
  }
  return read_sensor_model(file, effect_catalogue());
}

// One sensor's frames of all scenes as a set of their own. Returns the number of frames.
int simulate_sensor(const WorldProvider& provider, int index, const std::string& out, const SimulateOptions& options) {
  SyntheticOptions synthetic;
  synthetic.sensor = index;
  synthetic.seed = options.common.seed;
  synthetic.with_rgb = !options.no_rgb;
  const WorldSensor sensor = provider.now()->sensors[static_cast<std::size_t>(index)];
  SyntheticCamera camera(provider, model_of(sensor, options), synthetic);

  SetInfo info;
  info.sensor = camera.info().sensor;
  RecordingWriter writer(out, info);
  BopExtras extras(out);
  Progress progress("simulating " + sensor.name, std::int64_t{options.scenes} * options.frames);
  int written = 0;
  for (int scene = 0; scene < options.scenes; ++scene) {
    CaptureInfo capture;
    capture.split = options.split;
    capture.id = scene + 1;
    capture.name = fmt::format("{} {}", camera.world().name, scene + 1);
    writer.begin_capture(capture);
    if (!options.no_masks) extras.begin_capture(capture.folder(), capture.id);
    camera.begin_scene(scene, options.frames);
    for (int i = 0; i < options.frames; ++i) {
      const Frame frame = camera.frame();
      writer.write(frame);
      if (!options.no_masks) {
        std::vector<int> obj_ids;
        for (const ObjectPose& object : *frame.objects) obj_ids.push_back(object.obj_id);
        extras.add(i,
                   object_masks(camera.renderer(), camera.scene(), camera.request(), obj_ids.size(), frame.ids,
                                frame.depth_mm),
                   obj_ids);
      }
      ++written;
      progress.advance();
    }
    writer.finish_capture();
    if (!options.no_masks) extras.finish_capture();
  }
  write_bop_models(camera.world(), out);
  if (!options.no_masks) extras.write_targets();
  return written;
}

void simulate(const SimulateOptions& options) {
  apply(options.common);
  const WorldProvider provider = world_in_motion(read_world(options.world), options.common.seed);
  const std::size_t sensors = provider.now()->sensors.size();
  for (std::size_t i = 0; i < sensors; ++i) {
    const std::string out = sensors == 1 ? options.out : options.out + "/" + provider.now()->sensors[i].name;
    const int written = simulate_sensor(provider, static_cast<int>(i), out, options);
    fmt::print("{} frames of {} scenes simulated in {}\n", written, options.scenes, out);
  }
}

}  // namespace

void add_simulate(CLI::App& app, int& status) {
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* verb = app.add_subcommand("simulate", "a world through a sensor model into a BOP dataset");
  verb->add_option("--world", options->world, "the world, for example worlds/parts-on-a-table.yaml")->required();
  verb->add_option("--model", options->model, "the sensor model; default: what the world's sensors say");
  verb->add_option("--out", options->out, "the dataset; with several sensors a folder with one for each")->required();
  verb->add_option("--scenes", options->scenes, "how many scenes: piles, or poses of a moving mount")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--frames", options->frames, "frames of each scene")->check(CLI::Range(1, 1000000));
  verb->add_option("--split", options->split, "train (to fit on) or test (held out)")
      ->check(CLI::IsMember({"train", "test"}));
  verb->add_flag("--no-rgb", options->no_rgb, "leave out the colour images");
  verb->add_flag("--no-masks", options->no_masks, "leave out whole masks, scene_gt_info and targets (faster)");
  add_common_options(*verb, options->common);
  verb->callback([options, &status] {
    simulate(*options);
    status = 0;
  });
}

}  // namespace binrig
