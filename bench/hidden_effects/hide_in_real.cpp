// hide_in_real: hides effects in the frames of a real camera and asks the diagnosis which.
//
//   hide_in_real SET MODEL.yaml --effects a,b [--strength strong --most 2 --seed 1]
//
// MODEL.yaml is the camera's model as far as it could be improved: what it leaves unexplained stays beside the hidden
// effect, whose code is the benchmark's own and shares nothing with the catalogue. First the recording as it is.
#include <cstdio>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/forward.h"
#include "bench/hidden_effects/study.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "sim/effect.h"

namespace binrig::hidden {
namespace {

int run(int argc, char** argv) {
  std::string set_path, model_path, strength = "strong";
  std::vector<std::string> effects;
  std::uint64_t seed = 1;
  int threads = 0;
  bool as_it_is = false;
  DiagnosisOptions options;
  options.most_effects = 2;
  CLI::App app{"Hides effects in the frames of a real camera and asks the diagnosis which"};
  app.add_option("set", set_path, "recording set")->required();
  app.add_option("model", model_path, "the camera's model")->required();
  app.add_option("--effects", effects, "hidden one by one")->delimiter(',');
  app.add_flag("--as-it-is", as_it_is, "also with nothing hidden");
  app.add_option("--strength", strength, "weak, medium or strong")->check(CLI::IsMember({"weak", "medium", "strong"}));
  app.add_option("--most", options.most_effects, "effects added one after another");
  app.add_option("--seed", seed, "of what is drawn");
  app.add_option("--jobs", threads, "threads; default: all cores");
  CLI11_PARSE(app, argc, argv);
  if (threads > 0) set_jobs(threads);
  const auto how = strength == "weak" ? Strength::weak : strength == "medium" ? Strength::medium : Strength::strong;

  SensorModel model = read_sensor_model(model_path, effect_catalogue());
  const Forward forward = open_forward_model(set_path);
  const auto* scenes = dynamic_cast<const SceneForwardModel*>(forward.model.get());
  if (!scenes) throw Error(set_path + " cannot be rendered");
  settle_projector(model, *forward.model);
  SimulationCache cache = SimulationCache::standard();
  const auto ask = [&](const std::string& name, const std::vector<HiddenEffect>& hidden) {
    const bench::Recording frames = record_on_top(*scenes, model, hidden, seed);
    const Diagnosis diagnosis = diagnose(
        *scenes, [&](int c, int i) { return frames[c][i]; }, model, cache, options);
    fmt::print("{}: {} ({:.0f} s)\n", name, verdict_name(diagnosis.verdict), diagnosis.seconds);
    for (const HiddenEffect& effect : hidden) {
      fmt::print("  truth");
      for (const auto& [parameter, value] : effect.values) fmt::print(" {} {:.4g}", parameter, value);
      fmt::print("\n");
    }
    for (const CandidateReport& candidate : diagnosis.candidates) {
      fmt::print("  {} held out {:.3g}:", candidate.effect, candidate.heldout_after);
      for (const auto& [parameter, value] : candidate.parameters) {
        fmt::print(" {} {:.4g}", parameter.name, value.value);
        if (value.ci95) fmt::print(" [{:.4g}, {:.4g}]", (*value.ci95)[0], (*value.ci95)[1]);
      }
      fmt::print("\n");
    }
    for (const LadderStep& step : diagnosis.ladder) fmt::print("  ladder {} {:.4g}\n", step.added, step.score.heldout);
    for (const Unexplained& rest : diagnosis.unexplained)
      fmt::print("  unexplained: {} {:.3g} times its randomness\n", rest.segment, rest.ratio);
    for (const std::string& warning : diagnosis.warnings) fmt::print("  {}\n", warning);
    std::fflush(stdout);
  };
  if (as_it_is) ask("nothing hidden", {});
  for (const std::string& name : effects)
    ask(name, {draw_hidden(name, how, RandomStream(seed).child("hidden in real frames"))});
  return 0;
}

}  // namespace
}  // namespace binrig::hidden

int main(int argc, char** argv) {
  binrig::Progress::silence();
  try {
    return binrig::hidden::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
