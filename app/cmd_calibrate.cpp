// binrig calibrate: the parameters of a model's effects from a recording, with intervals; those that the recording
// cannot determine are named.
#include <chrono>
#include <cstdio>
#include <filesystem>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "app/commands.h"
#include "app/forward.h"
#include "app/model_files.h"
#include "app/plane_start.h"
#include "core/error.h"
#include "core/recording_writer.h"
#include "diagnose/calibration.h"
#include "diagnose/plausibility.h"
#include "diagnose/step_reader.h"
#include "sim/effect.h"

namespace binrig {
namespace {

struct CalibrateOptions {
  std::string measured, model, out;
  CalibrationOptions fit;
  CommonOptions common;
};

// FILE.yaml, or a folder that gets model.yaml.
std::filesystem::path model_path(const std::string& out) {
  const std::filesystem::path path = std::filesystem::absolute(out);
  return path.extension() == ".yaml" || path.extension() == ".yml" ? path : path / "model.yaml";
}

nlohmann::json json_of(const Calibration& found, const CalibrateOptions& options, const std::vector<std::string>& notes,
                       double seconds) {
  nlohmann::json json{{"model", model_path(options.out).string()},
                      {"measured", options.measured},
                      {"converged", found.converged},
                      {"misfit", found.dispersion},
                      {"seconds", seconds},
                      {"notes", notes}};
  json["parameters"] = nlohmann::json::array();
  json["not_determined"] = nlohmann::json::array();
  for (const auto& p : found.parameters) {
    nlohmann::json entry{{"instance", p.id}, {"parameter", p.name}, {"unit", p.unit}};
    if (p.determined()) {
      entry["before"] = p.before;
      entry["value"] = p.value;
      entry["ci95"] = *p.ci95;
      entry["narrowing"] = p.narrowing;
      json["parameters"].push_back(entry);
    } else {
      entry["value"] = p.value;
      entry["reason"] = p.reason;
      json["not_determined"].push_back(entry);
    }
  }
  return json;
}

void print(const Calibration& found, const std::vector<std::string>& notes, const std::string& model) {
  fmt::print("{:<24}{:<20}{:>10} {:>10}  {:<26}\n", "effect", "parameter", "before", "fitted", "95 % interval");
  bool open = false;
  for (const auto& p : found.parameters) {
    open |= !p.determined();
    if (p.determined())
      fmt::print("{:<24}{:<20}{:>10.4g} {:>10.4g}  [{:.4g}, {:.4g}] {}\n", p.id, p.name, p.before, p.value,
                 (*p.ci95)[0], (*p.ci95)[1], p.unit);
  }
  if (open) fmt::print("\nNot determined by this recording (held by their start values):\n");
  for (const auto& p : found.parameters)
    if (!p.determined()) fmt::print("  {}.{} = {:.4g}: {}\n", p.id, p.name, p.value, p.reason);
  for (const auto& note : notes) fmt::print("note: {}\n", note);
  fmt::print("\nmodel: {}\n", model);
}

void run(const CalibrateOptions& options) {
  const auto began = std::chrono::steady_clock::now();
  SensorModel model = read_sensor_model(options.model, effect_catalogue());
  if (model.dot_pattern) throw Error(options.model + " is a first-principles instrument without effects to calibrate");
  const RecordingSet set = RecordingSet::open(options.measured);
  const Forward forward = open_forward_model(options.measured);
  std::vector<std::string> notes = forward.notes;
  if (const std::string projector = settle_projector(model, *forward.model); !projector.empty())
    notes.push_back(projector);
  std::vector<CaptureReader> readers;
  bool train = false;
  for (const auto& capture : forward.model->captures()) {
    readers.push_back(set.capture(capture.split, capture.id));
    train |= capture.split == "train";
  }
  if (!train) throw Error(options.measured + " has no capture to fit to in the split \"train\"");
  SimulationCache cache = SimulationCache::standard();
  const Experiment experiment(*forward.model, model, cache);
  const Experiment::FrameReader frames = [&](int c, int i) { return readers[c].frame(i); };
  StepReader steps(experiment, frames);
  const Measurement data = experiment.measure(steps.reader(), notes);
  check_registration(experiment, data.all, model);
  CalibrationOptions fit = options.fit;
  const SensorModel given = model;
  start_from_planes(model, options.measured, options.common.seed,
                    [&](const std::string& id, const std::string& name) { return is_fitted(fit, id, name); });
  fit.seen = steps.seen(without_steps(model, effect_catalogue()));
  fit.seed = options.common.seed;
  fit.provenance = std::filesystem::weakly_canonical(options.measured).filename().string() + ", split train";
  Calibration found = calibrate(experiment, data, model, fit);
  for (auto& p : found.parameters) p.before = given.find(p.id)->value(p.name);
  if (found.dispersion > 1.3)
    notes.push_back(fmt::format(
        "the recording departs from the fitted model by {:.1f} times the model's own randomness: an effect is missing "
        "(binrig diagnose says which); intervals are widened accordingly",
        std::sqrt(found.dispersion)));
  if (!found.converged) notes.push_back("the last step was still large: calibrate again from the model written");

  const std::filesystem::path path = model_path(options.out);
  std::filesystem::create_directories(path.parent_path());
  rebase_files(found.model, path.string());
  check_sensor_model(found.model, effect_catalogue());
  write_sensor_model(found.model, effect_catalogue(), path.string());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  const std::string json = json_of(found, options, notes, seconds).dump(1);
  const std::string beside = path.stem() == "model" ? "calibration.json" : path.stem().string() + ".calibration.json";
  write_file_atomically((path.parent_path() / beside).string(), json);
  if (options.common.json)
    std::puts(json.c_str());
  else
    print(found, notes, path.string());
}

}  // namespace

void add_calibrate(CLI::App& app, int& status) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* verb = app.add_subcommand(
      "calibrate", "fits the parameters of a model's effects to a recording, with intervals, by simulating it");
  verb->add_option("--measured", options->measured, "recording set; its train captures are fitted to")->required();
  verb->add_option("--model", options->model, "sensor model to start from")->required();
  verb->add_option("--out", options->out, "model to write (FILE.yaml), or a folder for model.yaml")->required();
  verb->add_option("--fix", options->fit.fixed, "ID or ID.PARAMETER that keeps its value; may be repeated");
  verb->add_option("--only", options->fit.only, "fit this ID or ID.PARAMETER and nothing else; may be repeated");
  add_common_options(*verb, options->common);
  verb->callback([options, &status] {
    apply(options->common);
    run(*options);
    status = 0;
  });
}

}  // namespace binrig
