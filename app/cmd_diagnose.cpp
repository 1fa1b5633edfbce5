// binrig diagnose: which physical effect a model lacks, or that it lacks nothing, or that it is none of those known.
#include <filesystem>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "app/diagnosis_page.h"
#include "core/recording_writer.h"

namespace binrig {

void add_diagnose(CLI::App& app, int& /*status*/) {
  struct Options {
    DiagnosisRun run;
    std::string out;
    CommonOptions common;
  };
  auto options = std::make_shared<Options>();
  CLI::App* verb = app.add_subcommand(
      "diagnose",
      "which physical effect a model lacks on a recording, or that it lacks nothing, or that it is none known");
  verb->add_option("--measured", options->run.measured, "recording set of known targets, with train and test captures")
      ->required();
  verb->add_option("--model", options->run.model, "sensor model (YAML)")->required();
  verb->add_option("--out", options->out, "folder for report.html, diagnosis.json and ladder.json")->required();
  add_common_options(*verb, options->common);
  verb->callback([options] {
    apply(options->common);
    options->run.seed = options->common.seed;
    const Diagnosis diagnosis = run_diagnosis(options->run);
    std::filesystem::create_directories(options->out);
    const std::string text = diagnosis_json(diagnosis);
    write_file_atomically(options->out + "/diagnosis.json", text + "\n");
    write_file_atomically(options->out + "/ladder.json", ladder_json(diagnosis) + "\n");
    const std::string page = write_diagnosis_page(diagnosis, options->run, options->out, false);
    if (options->common.json)
      fmt::print("{}\n", text);
    else
      fmt::print("{}\n{}\n", diagnosis_words(diagnosis), page);
  });
}

}  // namespace binrig
