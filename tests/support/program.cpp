#include "tests/support/program.h"

#include <sys/wait.h>

#include <cstdio>
#include <fstream>

namespace binrig::test {

Run run_binrig(const std::string& arguments) {
  Run run;
  FILE* pipe = ::popen((std::string(BINRIG_PROGRAM) + " " + arguments + " 2>&1").c_str(), "r");
  if (!pipe) return run;
  char buffer[4096];
  for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) run.output.append(buffer, n);
  const int code = ::pclose(pipe);
  run.status = WIFEXITED(code) ? WEXITSTATUS(code) : 128 + WTERMSIG(code);
  return run;
}

nlohmann::json read_json(const std::string& path) {
  std::ifstream file(path);
  return nlohmann::json::parse(file);
}

}  // namespace binrig::test
