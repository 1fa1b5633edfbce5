#include <cstdlib>
#include <filesystem>

#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "core/parallel.h"
#include "core/progress.h"

namespace binrig {

void add_common_options(CLI::App& verb, CommonOptions& options) {
  verb.add_option("--jobs", options.jobs, "threads to use (0 = all cores)")->check(CLI::Range(0, 1024));
  verb.add_option("--seed", options.seed, "seed of every random draw: the same seed gives the same bytes");
  verb.add_flag("--json", options.json, "print the result as JSON on standard output");
  verb.add_flag("--quiet", options.quiet, "no progress bar");
}

void apply(const CommonOptions& options) {
  set_jobs(options.jobs);
  if (options.quiet) Progress::silence();
}

std::string recordings_folder() {
  if (const char* given = std::getenv("BINRIG_RECORDINGS")) return std::filesystem::is_directory(given) ? given : "";
  const std::filesystem::path beside = std::filesystem::path(BINRIG_SOURCE_DIR).parent_path() / "shared" / "recordings";
  return std::filesystem::is_directory(beside) ? beside.string() : "";
}

}  // namespace binrig
