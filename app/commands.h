// The verbs of the command line, one file cmd_NAME.cpp each.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace binrig {

/// A verb: adds its subcommand to the program and says what to run (as a callback of the subcommand); the exit status
/// goes to `status`: 0 = the work was done, 1 = a check that was asked for failed. Errors are thrown; main makes 2 or 3
/// of them. cmd_fit_noise.cpp defines `void add_fit_noise(CLI::App&, int&)`: the build finds it and writes the table.
using AddVerb = void (*)(CLI::App& app, int& status);
const std::vector<AddVerb>& all_verbs();

/// Options that every long verb has: --jobs N, --seed N, --json, --quiet. `json` = print the report's JSON on stdout
/// instead of words.
struct CommonOptions {
  int jobs = 0;
  std::uint64_t seed = 1;
  bool json = false;
  bool quiet = false;
};
void add_common_options(CLI::App& verb, CommonOptions& options);
/// Applies jobs and quiet to the process. Call first in a verb.
void apply(const CommonOptions& options);

/// Where the shared recordings are: BINRIG_RECORDINGS, else ../shared/recordings beside the source tree; "" if absent.
std::string recordings_folder();

}  // namespace binrig
