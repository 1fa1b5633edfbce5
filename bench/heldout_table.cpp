// The table of docs/real-sensors.md: two models calibrated to the train captures of a recording set, and how far each
// is from the captures held out, channel by channel, on one scale.
//
//   heldout_table SET BASE.yaml CAMERA.yaml OUT [from-file] [ID.PARAMETER of CAMERA that stays ...]
//
// from-file: the camera's fit begins where its file says, and not where planes put its noise.
//
// Writes OUT/base.yaml and OUT/camera.yaml. The scale is the second model's own randomness with the practical floors: 1
// is as near as its own simulations are to each other.
#include <cstdio>
#include <filesystem>

#include <fmt/format.h>

#include "app/forward.h"
#include "app/model_files.h"
#include "app/plane_start.h"
#include "core/error.h"
#include "core/progress.h"
#include "diagnose/calibration.h"
#include "diagnose/score.h"
#include "diagnose/step_reader.h"
#include "sim/effect.h"

using namespace binrig;

namespace {

void print(const Calibration& found, const std::string& name) {
  fmt::print("\n{}: misfit {:.3g}{}\n", name, found.dispersion, found.converged ? "" : ", last step still large");
  for (const auto& p : found.parameters)
    if (p.determined())
      fmt::print("  {}.{} {:.4g} -> {:.4g} [{:.4g}, {:.4g}] {}\n", p.id, p.name, p.before, p.value, (*p.ci95)[0],
                 (*p.ci95)[1], p.unit);
    else
      fmt::print("  {}.{} {:.4g}: {}\n", p.id, p.name, p.value, p.reason);
}

int run(const std::string& path, const std::vector<std::string>& files, const std::string& out,
        const std::vector<std::string>& fixed) {
  const RecordingSet set = RecordingSet::open(path);
  const Forward forward = open_forward_model(path);
  std::vector<CaptureReader> readers;
  for (const auto& capture : forward.model->captures()) readers.push_back(set.capture(capture.split, capture.id));
  SimulationCache cache = SimulationCache::standard();
  std::vector<SensorModel> models;
  for (const auto& file : files) models.push_back(read_sensor_model(file, effect_catalogue()));
  for (auto& model : models) settle_projector(model, *forward.model);
  const Experiment experiment(*forward.model, models[1], cache);
  std::vector<std::string> unreadable;
  const Experiment::FrameReader frames = [&](int c, int i) { return readers[c].frame(i); };
  StepReader steps(experiment, frames);
  const Measurement measured = experiment.measure(steps.reader(), unreadable);
  std::vector<Rung> rungs;
  std::filesystem::create_directories(out);
  for (int k : {0, 1}) {
    CalibrationOptions options;
    if (k == 1) options.fixed = fixed;
    options.seen = steps.seen(without_steps(models[k], effect_catalogue()));
    const bool from_file = std::erase(options.fixed, "from-file") > 0;
    options.provenance = std::filesystem::weakly_canonical(path).filename().string() + ", split train";
    if (!from_file)
      start_from_planes(models[k], path, options.seed,
                        [&](const std::string& id, const std::string& name) { return is_fitted(options, id, name); });
    Calibration found = calibrate(experiment, measured, models[k], options);
    const std::string file = out + (k == 0 ? "/base.yaml" : "/camera.yaml");
    rebase_files(found.model, file);
    write_sensor_model(found.model, effect_catalogue(), file);
    print(found, models[k].name);
    rungs.push_back(std::move(found.rung));
  }
  const auto motions =
      scene_motions(experiment, rungs[1].model, registration_prior(forward.model->set(), experiment.nominal(0).camera));
  const auto judged = scores(experiment.layout(), motions, rungs[1], measured.all, {&rungs[0], &rungs[1]});
  fmt::print("\n| channel | {} | {} |\n|---|---|---|\n", models[0].name, models[1].name);
  for (const auto& [segment, value] : judged[0].by_segment)
    fmt::print("| {} | {:.3g} | {:.3g} |\n", segment, value, judged[1].by_segment.at(segment));
  fmt::print("| all | {:.3g} | {:.3g} |\n", judged[0].heldout, judged[1].heldout);
  fmt::print("| bias RMS (mm) | {:.3g} | {:.3g} |\n", judged[0].bias_rms_mm, judged[1].bias_rms_mm);
  fmt::print("| noise, measured over simulated | {:.3g} | {:.3g} |\n", judged[0].noise_ratio, judged[1].noise_ratio);
  fmt::print("| drop-out shares differ by | {:.3g} | {:.3g} |\n", judged[0].mask_difference, judged[1].mask_difference);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fputs("heldout_table SET BASE.yaml CAMERA.yaml OUT [ID.PARAMETER ...]\n", stderr);
    return 2;
  }
  Progress::silence();
  try {
    return run(argv[1], {argv[2], argv[3]}, argv[4], {argv + 5, argv + argc});
  } catch (const Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
