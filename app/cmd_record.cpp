// binrig record: frames of any source into a recording set.
#include <cstdio>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "app/commands.h"
#include "app/open.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/recording_writer.h"
#include "core/uri.h"

namespace binrig {
namespace {

struct RecordOptions {
  std::string from, out, split = "train", name, target;
  int id = 1, frames = 0;
  bool power_on = false;
  double timeout_s = 5;
  CommonOptions common;
};

// What is known of the set that a replay comes from goes along: pose uncertainties, region, models.
SetInfo set_info_of(const SourceInfo& source, const Uri& uri, std::string* models_from) {
  SetInfo info;
  if (uri.scheme == "replay") {
    info = RecordingSet::open(uri.path).info();
    *models_from = uri.path;
  }
  info.sensor = source.sensor;
  info.valid_region = source.valid_region;
  info.captures.clear();
  return info;
}

struct Tally {
  int written = 0, broken = 0, silent = 0;
};

void record_capture(const std::string& uri, const CaptureInfo& capture, const RecordOptions& options,
                    RecordingWriter& writer, Tally& tally) {
  const std::unique_ptr<FrameSource> source = open_source(uri);
  const SourceInfo info = source->info();
  if (options.frames == 0 && !info.frames) throw Error(uri + " never ends: say how many with --frames N");
  const std::int64_t wanted = options.frames > 0 ? options.frames : *info.frames;
  const auto timeout = std::chrono::milliseconds(static_cast<int>(options.timeout_s * 1000));
  Progress progress("recording " + capture.key(), wanted);
  writer.begin_capture(capture);
  source->start();
  for (std::int64_t taken = 0; taken < wanted;) {
    std::optional<Frame> frame;
    try {
      frame = source->next(timeout);
    } catch (const Error& problem) {
      fmt::print(stderr, "left out: {}\n", problem.what());
      ++tally.broken;
      ++taken;
      continue;
    }
    if (!frame) break;
    writer.write(*frame);
    tally.silent += frame->status == FrameStatus::timeout || frame->status == FrameStatus::device_lost;
    ++tally.written;
    ++taken;
    progress.advance();
    if (frame->status == FrameStatus::device_lost) break;
  }
  source->stop();
  writer.finish_capture();
}

void record(const RecordOptions& options, bool id_given) {
  apply(options.common);
  const Uri uri = Uri::parse(options.from);
  std::string models_from;
  SetInfo info;
  {
    const std::unique_ptr<FrameSource> source = open_source(options.from);
    info = set_info_of(source->info(), uri, &models_from);
  }
  RecordingWriter writer(options.out, info);
  Tally tally;
  // A whole set without a capture of its own choice is re-recorded capture by capture.
  if (uri.scheme == "replay" && uri.fragment.empty() && !id_given) {
    std::string rest = uri.text.substr(std::string("replay:").size() + uri.path.size());
    const RecordingSet set = RecordingSet::open(uri.path);
    for (const CaptureInfo& capture : set.captures()) {
      record_capture("replay:" + uri.path + "#" + capture.key() + rest, capture, options, writer, tally);
    }
  } else {
    CaptureInfo capture;
    if (uri.scheme == "replay" && !uri.fragment.empty()) capture = RecordingSet::open(uri.path).capture(uri.fragment).info();
    capture.split = options.split;
    capture.id = options.id;
    if (!options.name.empty()) capture.name = options.name;
    if (!options.target.empty()) capture.target = options.target == "plane" ? TargetKind::plane : TargetKind::scene;
    capture.power_on |= options.power_on;
    record_capture(options.from, capture, options, writer, tally);
  }
  if (!models_from.empty()) writer.copy_models(models_from);
  fmt::print("{} frames recorded in {}", tally.written, options.out);
  if (tally.silent > 0) fmt::print(", {} of them without an image (the device was silent)", tally.silent);
  if (tally.broken > 0) fmt::print("; {} broken ones left out", tally.broken);
  if (writer.storage_loss_mm() > 1e-4) fmt::print("; stored depth differs by up to {:.4g} mm", writer.storage_loss_mm());
  fmt::print("\n");
}

}  // namespace

void add_record(CLI::App& app, int& status) {
  auto options = std::make_shared<RecordOptions>();
  CLI::App* verb = app.add_subcommand("record", "frames of any source (replay:, sim:, cameras) into a recording set");
  verb->add_option("--from", options->from, "the source, for example replay:SET#train/1")->required();
  verb->add_option("--out", options->out, "the recording set; an existing one of the same sensor gets one more capture")->required();
  verb->add_option("--split", options->split, "train (to fit on) or test (held out)")->check(CLI::IsMember({"train", "test"}));
  CLI::Option* id = verb->add_option("--id", options->id, "number of the capture")->check(CLI::Range(0, 999999));
  verb->add_option("--frames", options->frames, "how many (0 = all)")->check(CLI::Range(0, 100000000));
  verb->add_option("--name", options->name, "a name people understand, for example plane_800");
  verb->add_option("--target", options->target, "what the camera looks at")->check(CLI::IsMember({"plane", "scene"}));
  verb->add_flag("--power-on", options->power_on, "the sensor was switched on just before the first frame");
  verb->add_option("--timeout", options->timeout_s, "seconds to wait for a frame")->check(CLI::Range(0.001, 3600.0));
  add_common_options(*verb, options->common);
  verb->callback([options, id, &status] {
    record(*options, id->count() > 0);
    status = 0;
  });
}

}  // namespace binrig
