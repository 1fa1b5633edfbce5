#include "core/uri.h"

#include "core/error.h"

namespace binrig {

Uri Uri::parse(const std::string& text) {
  Uri uri;
  uri.text = text;
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos || colon == 0) {
    throw Error("not a source: '" + text + "' has no scheme (replay:SET, sim:WORLD.yaml, ...)");
  }
  uri.scheme = text.substr(0, colon);
  std::string rest = text.substr(colon + 1);
  const std::size_t end = rest.find_first_of("#?");
  uri.path = rest.substr(0, end);
  while (!rest.empty() && rest.find_first_of("#?") != std::string::npos) {
    rest = rest.substr(rest.find_first_of("#?"));
    const bool fragment = rest[0] == '#';
    rest = rest.substr(1);
    const std::string part = rest.substr(0, rest.find_first_of("#?"));
    if (fragment) {
      uri.fragment = part;
      continue;
    }
    for (std::size_t at = 0; at < part.size();) {
      const std::size_t next = std::min(part.find('&', at), part.size());
      const std::string item = part.substr(at, next - at);
      const std::size_t equal = item.find('=');
      if (equal == std::string::npos || equal == 0) throw Error("in " + text + ": '" + item + "' is no KEY=VALUE");
      uri.options[item.substr(0, equal)] = item.substr(equal + 1);
      at = next + 1;
    }
  }
  return uri;
}

std::optional<std::string> Uri::take(const std::string& key) {
  const auto found = options.find(key);
  if (found == options.end()) return std::nullopt;
  std::string value = found->second;
  options.erase(found);
  return value;
}

void Uri::finish(const std::vector<std::string>& known) const {
  Violations violations;
  for (const auto& [key, value] : options) {
    const std::string near = nearest_word(key, known);
    violations.add(text, key, "is an unknown option" + (near.empty() ? std::string() : ": did you mean " + near + "?"));
  }
  violations.throw_if_any("the source cannot be opened");
}

}  // namespace binrig
