// Progress of long work: a bar on a terminal, a plain line now and then elsewhere. Written to stderr.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

namespace binrig {

class Progress {
 public:
  /// `total` <= 0: unknown. Nothing is printed for work that ends within half a second.
  Progress(const std::string& what, std::int64_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Thread-safe.
  void advance(std::int64_t steps = 1);
  /// Silences all bars of the process (`--quiet`, tests).
  static void silence(bool silent = true);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace binrig
