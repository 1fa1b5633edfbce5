// A YAML reader that reports every violation with file and line, unknown keys included.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/error.h"

namespace YAML {
class Node;
}

namespace binrig {

/// A mapping that is being read. Every key asked for counts as known; finish() reports the others with the nearest
/// known key. Wrong types and bounds become violations, never exceptions; the getter then returns its default.
class YamlMap {
 public:
  /// `path` is the key's place in the file for messages ("camera", "parts[2]"), "" at the top.
  YamlMap(const YAML::Node& node, std::string file, std::string path, Violations& violations);
  ~YamlMap();
  YamlMap(YamlMap&&) noexcept;

  bool has(const std::string& key) const;
  std::optional<double> number(const std::string& key, double lower, double upper, const std::string& unit);
  double number(const std::string& key, double fallback, double lower, double upper, const std::string& unit);
  int integer(const std::string& key, int fallback, int lower, int upper);
  bool boolean(const std::string& key, bool fallback);
  std::optional<std::string> text(const std::string& key);
  std::string text(const std::string& key, const std::string& fallback, const std::vector<std::string>& choices = {});
  /// Exactly `count` numbers (0 = any number of them).
  std::optional<std::vector<double>> numbers(const std::string& key, int count, double lower, double upper,
                                             const std::string& unit);
  std::optional<YamlMap> map(const std::string& key);
  /// The elements of a list of mappings; empty where absent.
  std::vector<YamlMap> maps(const std::string& key);
  /// The raw node, for shapes that the getters do not know; counts as known.
  YAML::Node node(const std::string& key);
  std::vector<std::string> keys() const;

  /// "file:line" of a key, or of the mapping itself.
  std::string where(const std::string& key = "") const;
  void violation(const std::string& key, const std::string& message);
  void missing(const std::string& key, const std::string& what);
  /// Reports unknown keys. Call once, when every known key has been asked for.
  void finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Parses a file. Throws Error with file:line for a syntax error or if it cannot be read.
YAML::Node load_yaml_file(const std::string& path);
YAML::Node parse_yaml(const std::string& text, const std::string& name);

}  // namespace binrig
