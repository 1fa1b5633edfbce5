// binrig VERB: the command line.
#include <cstdio>
#include <exception>

#include <CLI/CLI.hpp>

#include "app/commands.h"
#include "core/error.h"

int main(int argc, char** argv) {
  CLI::App app{"binrig: a hardware-in-the-loop validation rig for depth cameras and bin picking"};
  app.require_subcommand(1);
  app.set_version_flag("--version", BINRIG_VERSION);
  int status = 0;
  for (auto* add : binrig::all_verbs()) add(app, status);
  try {
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
