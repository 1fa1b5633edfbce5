// binrig VERB: the command line.
#include <algorithm>
#include <cstdio>
#include <exception>

#include <malloc.h>

#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "core/error.h"

namespace {

// CLI11 says only that a subcommand is required; a mistyped one deserves its nearest neighbour.
void check_verb(const CLI::App& app, const std::string& word) {
  std::vector<std::string> verbs;
  for (const CLI::App* verb : app.get_subcommands([](const CLI::App*) { return true; })) verbs.push_back(verb->get_name());
  if (word.empty() || word[0] == '-' || std::find(verbs.begin(), verbs.end(), word) != verbs.end()) return;
  const std::string near = binrig::nearest_word(word, verbs);
  throw binrig::Error("there is no verb '" + word + "'" + (near.empty() ? ": binrig --help lists them" : ": did you mean " + near + "?"));
}

/// Images come and go by the thousand. Left alone, the allocator gives each back to the kernel and has it zeroed again:
/// a fourteenth of a diagnosis at 640 x 480.
void keep_freed_images() {
  constexpr int bytes = 24 << 20;  // some twenty images of that size, by thread
  mallopt(M_MMAP_THRESHOLD, bytes);
  mallopt(M_TRIM_THRESHOLD, bytes);
}

}  // namespace

int main(int argc, char** argv) {
  keep_freed_images();
  CLI::App app{"binrig: a hardware-in-the-loop validation rig for depth cameras and bin picking"};
  app.require_subcommand(1);
  app.set_version_flag("--version", BINRIG_VERSION);
  int status = 0;
  for (auto* add : binrig::all_verbs()) add(app, status);
  try {
    if (argc > 1) check_verb(app, argv[1]);
    app.parse(argc, argv);
    return status;
  } catch (const CLI::CallForHelp& help) {
    return app.exit(help);
  } catch (const CLI::CallForVersion& version) {
    return app.exit(version);
  } catch (const CLI::ParseError& problem) {
    app.exit(problem);
    return 2;
  } catch (const binrig::Error& problem) {
    std::fprintf(stderr, "binrig: %s\n", problem.what());
    return problem.kind() == binrig::ErrorKind::device ? 3 : 2;
  } catch (const std::exception& problem) {
    std::fprintf(stderr, "binrig: %s\n", problem.what());
    return 2;
  }
}
