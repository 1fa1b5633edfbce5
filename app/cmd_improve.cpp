// binrig improve: adds effect after effect until nothing is missing, and shows the held-out error falling.
#include <filesystem>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "app/diagnosis_page.h"
#include "core/recording_writer.h"
#include "sim/effect.h"

namespace binrig {

void add_improve(CLI::App& app, int& /*status*/) {
  struct Options {
    DiagnosisRun run;
    std::string out;
    CommonOptions common;
  };
  auto options = std::make_shared<Options>();
  CLI::App* verb = app.add_subcommand(
      "improve", "diagnose, add the missing effect, fit again, until nothing is missing: model.yaml and the ladder");
  verb->add_option("--measured", options->run.measured, "recording set of known targets, with train and test captures")
      ->required();
  verb->add_option("--model", options->run.model, "sensor model to start from (YAML)")->required();
  verb->add_option("--out", options->out, "folder for model.yaml, ladder.json, diagnosis.json and report.html")
      ->required();
  verb->add_option("--max-effects", options->run.most_effects, "stop after so many added effects")
      ->check(CLI::Range(0, 20))
      ->default_val(6);
  add_common_options(*verb, options->common);
  verb->callback([options] {
    apply(options->common);
    options->run.seed = options->common.seed;
    const Diagnosis diagnosis = run_diagnosis(options->run);
    std::filesystem::create_directories(options->out);
    write_sensor_model(diagnosis.improved, effect_catalogue(), options->out + "/model.yaml");
    const std::string ladder = ladder_json(diagnosis);
    write_file_atomically(options->out + "/ladder.json", ladder + "\n");
    write_file_atomically(options->out + "/diagnosis.json", diagnosis_json(diagnosis) + "\n");
    const std::string page = write_diagnosis_page(diagnosis, options->run, options->out, true);
    if (options->common.json) {
      fmt::print("{}\n", ladder);
      return;
    }
    for (const auto& step : diagnosis.ladder)
      fmt::print("{:>2}  {:<24} held-out {:.3g}\n", step.step, step.name("(the model given)"), step.score.heldout);
    fmt::print("{}\n{}/model.yaml\n{}\n", diagnosis_words(diagnosis), options->out, page);
  });
}

}  // namespace binrig
