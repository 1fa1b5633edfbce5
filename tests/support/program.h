// The program as a user runs it.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace binrig::test {

struct Run {
  int status = -1;     ///< exit status; 128 + signal where it was killed
  std::string output;  ///< standard output and error together
};

/// Runs the built `binrig` with these arguments (shell words).
Run run_binrig(const std::string& arguments);

/// A file that it wrote. Throws nlohmann::json::exception if it is missing or no JSON.
nlohmann::json read_json(const std::string& path);

}  // namespace binrig::test
