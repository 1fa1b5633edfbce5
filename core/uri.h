// URIs of sources and bins: SCHEME:PATH[#FRAGMENT][?KEY=VALUE&...] (fragment and options in either order).
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace binrig {

struct Uri {
  std::string text, scheme, path, fragment;
  std::map<std::string, std::string> options;

  /// Throws Error if there is no scheme or an option has no value.
  static Uri parse(const std::string& text);
  /// Takes an option out, so that finish() can tell what nobody asked for.
  std::optional<std::string> take(const std::string& key);
  /// Throws Error naming every option left, with the nearest of `known`.
  void finish(const std::vector<std::string>& known) const;
};

}  // namespace binrig
