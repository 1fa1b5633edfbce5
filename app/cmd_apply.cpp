// binrig apply: the sensor on anybody's perfect depth.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/random.h"
#include "core/recording_writer.h"
#include "sim/sensor.h"

namespace binrig {
namespace {

struct ApplyOptions {
  std::string model, in, out;
  CommonOptions common;
};

double reference_mm(const SensorModel& model, const SetInfo& info, const Frame& first) {
  if (model.reference_from == Given::written) return model.reference_distance_mm;
  if (const auto range = model.range_mm ? model.range_mm : info.sensor.range_mm) return ((*range)[0] + (*range)[1]) / 2;
  std::vector<float> depths;
  for (int row = 0; row < first.depth_mm.rows; row += 2) {
    for (int col = 0; col < first.depth_mm.cols; col += 2) {
      if (first.depth_mm.at<float>(row, col) > 0) depths.push_back(first.depth_mm.at<float>(row, col));
    }
  }
  if (depths.empty()) throw Error("the first frame has no depth, so the model's reference distance must be written");
  std::nth_element(depths.begin(), depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2), depths.end());
  return depths[depths.size() / 2];
}

struct Tally {
  int frames = 0;
  std::vector<std::string> inactive;
};

void apply_to_capture(const SensorModel& model, const CaptureReader& reader, const SetInfo& info, std::uint64_t seed,
                      RecordingWriter& writer, Tally& tally) {
  CaptureInfo capture = reader.info();
  std::optional<SensorRun> run;
  CaptureContext context;
  ChannelSet wanted = 0;
  std::optional<double> first_time_s;
  writer.begin_capture(capture);
  Progress progress("applying to " + capture.key(), reader.size());
  for (int i = 0; i < reader.size(); ++i) {
    const Frame perfect = reader.frame(i);
    if (!run) {
      context.camera = perfect.camera;
      if (model.projector_known) {
        context.projector_xyz_mm = model.projector_xyz_mm;
      } else {
        context.projector_xyz_mm = info.sensor.projector();
      }
      context.reference_distance_mm = reference_mm(model, info, perfect);
      context.depth_scale_mm = model.depth_scale_from == Given::written ? model.depth_scale_mm : perfect.depth_scale_mm;
      context.frames = reader.size();
      context.power_on = capture.power_on;
      context.seed = seed;
      context.unit_seed = model.unit_seed;
      context.capture_key = hash_text(capture.key());
      run.emplace(model, context);
      wanted = SensorRun::needed_channels(model, true);
      for (const auto& [id, why] : run->inactive()) tally.inactive.push_back(capture.key() + ": " + id + " " + why);
      first_time_s = perfect.time_s;
    }
    const auto channels = channels_from_depth(perfect.depth_mm, perfect.camera, context.projector_xyz_mm,
                                              context.reference_distance_mm, wanted);
    FrameInstant instant;
    instant.number = i;
    instant.time_s = perfect.time_s && first_time_s ? *perfect.time_s - *first_time_s : i;
    if (capture.power_on) instant.since_power_on_s = instant.time_s;
    Frame frame = run->frame(*channels, instant);
    frame.camera = perfect.camera;
    frame.X_WC = perfect.X_WC;
    frame.objects = perfect.objects;
    frame.ids = perfect.ids;
    frame.rgb = perfect.rgb;
    frame.time_s = perfect.time_s;
    frame.host_time_s = perfect.host_time_s;
    frame.sequence = perfect.sequence;
    writer.write(frame);
    ++tally.frames;
    progress.advance();
  }
  writer.finish_capture();
}

void apply_model(const ApplyOptions& options) {
  apply(options.common);
  const SensorModel model = read_sensor_model(options.model, effect_catalogue());
  if (model.dot_pattern) {
    throw Error(options.model +
                " is an instrument from first principles: it needs a scene (binrig simulate), not depth alone");
  }
  const RecordingSet set = RecordingSet::open(options.in);
  SetInfo info = set.info();
  info.captures.clear();
  if (model.projector_known) info.sensor.projector_xyz_mm = model.projector_xyz_mm;
  info.sensor.ir_full_scale = 65535;
  RecordingWriter writer(options.out, info);
  Tally tally;
  for (const CaptureInfo& capture : set.captures()) {
    apply_to_capture(model, set.capture(capture.key()), info, options.common.seed, writer, tally);
  }
  writer.copy_models(options.in);
  fmt::print("{} frames of {} captures through {} in {}\n", tally.frames, set.captures().size(), model.name,
             options.out);
  for (const std::string& line : tally.inactive) fmt::print("inactive: {}\n", line);
}

}  // namespace

void add_apply(CLI::App& app, int& status) {
  auto options = std::make_shared<ApplyOptions>();
  CLI::App* verb = app.add_subcommand("apply", "the sensor on anybody's perfect depth");
  verb->add_option("--model", options->model, "the sensor model")->required();
  verb->add_option("--in", options->in, "a recording set (BOP) of perfect depth")->required();
  verb->add_option("--out", options->out, "the new set")->required();
  add_common_options(*verb, options->common);
  verb->callback([options, &status] {
    apply_model(*options);
    status = 0;
  });
}

}  // namespace binrig
