#include "diagnose/cache.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

#include "core/random.h"

namespace binrig {
namespace fs = std::filesystem;
namespace {

constexpr std::uint32_t magic = 0x62726732;
constexpr std::uint32_t too_many = 1u << 28;  // values: no file of ours

/// Ends of alternating runs of values that are unknown (NaN) and known, the first one unknown, perhaps empty. A file
/// holds the known ones: a simulation is often of few captures.
std::vector<std::uint32_t> runs_of(const std::vector<float>& values) {
  std::vector<std::uint32_t> ends;
  bool known = false;
  for (std::size_t i = 0; i <= values.size(); ++i) {
    if (i < values.size() && std::isnan(values[i]) != known) continue;
    ends.push_back(static_cast<std::uint32_t>(i));
    known = !known;
  }
  return ends;
}

template <typename T>
bool read_into(std::istream& in, T* to, std::size_t count) {
  return static_cast<bool>(in.read(reinterpret_cast<char*>(to), static_cast<std::streamsize>(count * sizeof(T))));
}

template <typename T>
void write_from(std::ostream& out, const T* from, std::size_t count) {
  out.write(reinterpret_cast<const char*>(from), static_cast<std::streamsize>(count * sizeof(T)));
}

/// Removes the oldest files until at most bound bytes are left.
void trim(const std::string& folder, std::uint64_t bound) {
  struct Entry {
    fs::file_time_type time;
    std::uint64_t size;
    fs::path path;
  };
  std::vector<Entry> entries;
  std::uint64_t total = 0;
  std::error_code ignored;
  for (const auto& item : fs::recursive_directory_iterator(folder, ignored)) {
    if (!item.is_regular_file(ignored)) continue;
    entries.push_back({item.last_write_time(ignored), item.file_size(ignored), item.path()});
    total += entries.back().size;
  }
  if (total <= bound) return;
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.time < b.time; });
  for (const auto& entry : entries) {
    if (total <= bound * 3 / 4) break;
    fs::remove(entry.path, ignored);
    total -= entry.size;
  }
}

}  // namespace

SimulationCache SimulationCache::standard(std::uint64_t bound_mb) {
  if (const char* given = std::getenv("BINRIG_CACHE")) return SimulationCache(given, bound_mb);
  const char* home = std::getenv("HOME");
  return SimulationCache(home ? std::string(home) + "/.cache/binrig/statistics" : "", bound_mb);
}

SimulationCache::SimulationCache(const std::string& folder, std::uint64_t bound_mb, bool only_shared)
    : folder_(folder), only_shared_(only_shared) {
  if (folder_.empty()) return;
  std::error_code failed;
  fs::create_directories(folder_, failed);
  if (failed)
    folder_.clear();
  else
    trim(folder_, bound_mb << 20);
}

std::string SimulationCache::path(std::uint64_t key) const {
  char name[24];
  std::snprintf(name, sizeof name, "%02x/%014llx", static_cast<unsigned>(key >> 56),
                static_cast<unsigned long long>(key & 0xffffffffffffffull));
  return folder_ + "/" + name;
}

std::optional<std::vector<float>> SimulationCache::get(std::uint64_t key) const {
  if (!on()) return std::nullopt;
  std::ifstream in(path(key), std::ios::binary);
  std::uint32_t head[3] = {};  // and how many values and runs
  if (!read_into(in, head, 3) || head[0] != magic || head[1] > too_many || head[2] > head[1] + 2) return std::nullopt;
  std::vector<std::uint32_t> ends(head[2]);
  if (!read_into(in, ends.data(), ends.size())) return std::nullopt;
  std::vector<float> values(head[1], std::numeric_limits<float>::quiet_NaN());
  for (std::size_t r = 1; r < ends.size(); r += 2)
    if (ends[r - 1] > ends[r] || ends[r] > values.size() ||
        !read_into(in, values.data() + ends[r - 1], ends[r] - ends[r - 1]))
      return std::nullopt;
  return values;
}

void SimulationCache::put(std::uint64_t key, const std::vector<float>& values) const {
  if (!on()) return;
  const std::string final_path = path(key), temporary = final_path + "." + std::to_string(getpid());
  std::error_code ignored;
  fs::create_directories(fs::path(final_path).parent_path(), ignored);
  {
    std::ofstream out(temporary, std::ios::binary);
    const std::vector<std::uint32_t> ends = runs_of(values);
    const std::uint32_t head[3] = {magic, static_cast<std::uint32_t>(values.size()),
                                   static_cast<std::uint32_t>(ends.size())};
    write_from(out, head, 3);
    write_from(out, ends.data(), ends.size());
    for (std::size_t r = 1; r < ends.size(); r += 2)
      write_from(out, values.data() + ends[r - 1], ends[r] - ends[r - 1]);
    if (!out) {
      fs::remove(temporary, ignored);
      return;
    }
  }
  fs::rename(temporary, final_path, ignored);
}

std::uint64_t file_key(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return hash_text(path);
  std::uint64_t key = hash_text("file");
  std::vector<char> buffer(1 << 20);
  while (in.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || in.gcount() > 0)
    key = hash_text(std::string_view(buffer.data(), static_cast<std::size_t>(in.gcount())), key);
  return key;
}

std::uint64_t program_key() {
  static const std::uint64_t key = file_key("/proc/self/exe");
  return key;
}

}  // namespace binrig
