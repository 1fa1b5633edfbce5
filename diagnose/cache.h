// Simulated statistics kept on disk, by the content of everything they depend on.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace binrig {

class SimulationCache {
 public:
  /// In BINRIG_CACHE, else ~/.cache/binrig. At most `bound_mb` are kept: the oldest files go first. A folder that
  /// cannot be made switches the cache off.
  static SimulationCache standard(std::uint64_t bound_mb = 2048);
  /// "" = nothing is kept. `only_shared`: only what other recordings of the same scene can use (studies of many
  /// recordings, each diagnosed once).
  explicit SimulationCache(const std::string& folder, std::uint64_t bound_mb = 2048, bool only_shared = false);

  /// What was put in, NaN where that was NaN; nothing if it is not there or its file is torn. Throws nothing.
  std::optional<std::vector<float>> get(std::uint64_t key) const;
  /// Written to a temporary name and renamed; a full disk is no error. NaN (unknown) takes no room.
  void put(std::uint64_t key, const std::vector<float>& values) const;
  bool on() const { return !folder_.empty(); }
  bool only_shared() const { return only_shared_; }

 private:
  std::string path(std::uint64_t key) const;
  std::string folder_;
  bool only_shared_ = false;
};

/// Key of this very program: cached simulations of another build are never taken for its own.
std::uint64_t program_key();
/// Hash of a file's bytes; of its name alone where it cannot be read.
std::uint64_t file_key(const std::string& path);

}  // namespace binrig
