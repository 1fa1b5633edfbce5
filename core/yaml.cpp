#include "core/yaml.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include <yaml-cpp/yaml.h>

namespace binrig {

struct YamlMap::Impl {
  YAML::Node node;
  std::string file, path;
  Violations* violations;
  std::set<std::string> known;

  std::string full(const std::string& key) const { return path.empty() ? key : path + "." + key; }
};

namespace {
std::string line_of(const std::string& file, const YAML::Node& node) {
  const YAML::Mark mark = node.Mark();
  return mark.is_null() ? file : file + ":" + std::to_string(mark.line + 1);
}

std::string scalar_text(const YAML::Node& node) {
  if (node.IsScalar()) return node.Scalar();
  if (node.IsNull()) return "nothing";
  return node.IsMap() ? "a mapping" : "a list";
}

// yaml-cpp reads "nan" and ".inf" as numbers, too; bounds sort them out.
bool read_number(const YAML::Node& node, double& value) { return node.IsScalar() && YAML::convert<double>::decode(node, value); }

std::string bounds_text(double lower, double upper) {
  if (std::isinf(lower) && std::isinf(upper)) return "a number";
  if (std::isinf(upper)) return "at least " + number_text(lower);
  if (std::isinf(lower)) return "at most " + number_text(upper);
  return number_text(lower) + " .. " + number_text(upper);
}
}  // namespace

YamlMap::YamlMap(const YAML::Node& node, std::string file, std::string path, Violations& violations)
    : impl_(std::make_unique<Impl>()) {
  impl_->node = node;
  impl_->file = std::move(file);
  impl_->path = std::move(path);
  impl_->violations = &violations;
  if (!node.IsMap() && !node.IsNull()) {
    violations.add(line_of(impl_->file, node), impl_->path, "must be a mapping of keys to values");
    impl_->node = YAML::Node(YAML::NodeType::Map);
  }
}
YamlMap::~YamlMap() = default;
YamlMap::YamlMap(YamlMap&&) noexcept = default;

bool YamlMap::has(const std::string& key) const {
  const YAML::Node& node = impl_->node;  // a const node is never changed by a look-up
  return node.IsMap() && node[key].IsDefined();
}

YAML::Node YamlMap::node(const std::string& key) {
  impl_->known.insert(key);
  const YAML::Node& node = impl_->node;
  return has(key) ? node[key] : YAML::Node(YAML::NodeType::Undefined);
}

std::string YamlMap::where(const std::string& key) const {
  const YAML::Node& node = impl_->node;
  if (!key.empty() && has(key)) return line_of(impl_->file, node[key]);
  return line_of(impl_->file, node);
}

void YamlMap::violation(const std::string& key, const std::string& message) {
  impl_->violations->add(where(key), impl_->full(key), message);
}

void YamlMap::missing(const std::string& key, const std::string& what) {
  impl_->violations->add(where(), impl_->full(key), "is missing: " + what);
}

std::optional<double> YamlMap::number(const std::string& key, double lower, double upper, const std::string& unit) {
  const YAML::Node value = node(key);
  if (!value.IsDefined()) return std::nullopt;
  double number = 0;
  if (!read_number(value, number)) {
    impl_->violations->add({where(key), impl_->full(key), scalar_text(value), "", "", "is not a number"});
    return std::nullopt;
  }
  if (!(number >= lower && number <= upper) || !std::isfinite(number)) {
    impl_->violations->add(
        {where(key), impl_->full(key), scalar_text(value), unit, bounds_text(lower, upper), "is out of bounds"});
    return std::nullopt;
  }
  return number;
}

double YamlMap::number(const std::string& key, double fallback, double lower, double upper, const std::string& unit) {
  return number(key, lower, upper, unit).value_or(fallback);
}

int YamlMap::integer(const std::string& key, int fallback, int lower, int upper) {
  const std::optional<double> value = number(key, lower, upper, "");
  if (!value) return fallback;
  if (*value != std::round(*value)) {
    impl_->violations->add({where(key), impl_->full(key), number_text(*value), "", "", "is not a whole number"});
    return fallback;
  }
  return static_cast<int>(*value);
}

bool YamlMap::boolean(const std::string& key, bool fallback) {
  const YAML::Node value = node(key);
  if (!value.IsDefined()) return fallback;
  bool flag = fallback;
  if (!value.IsScalar() || !YAML::convert<bool>::decode(value, flag)) {
    impl_->violations->add({where(key), impl_->full(key), scalar_text(value), "", "true or false", ""});
  }
  return flag;
}

std::optional<std::string> YamlMap::text(const std::string& key) {
  const YAML::Node value = node(key);
  if (!value.IsDefined()) return std::nullopt;
  if (!value.IsScalar()) {
    impl_->violations->add({where(key), impl_->full(key), scalar_text(value), "", "", "is not a text"});
    return std::nullopt;
  }
  return value.Scalar();
}

std::string YamlMap::text(const std::string& key, const std::string& fallback, const std::vector<std::string>& choices) {
  const std::optional<std::string> value = text(key);
  if (!value) return fallback;
  if (choices.empty()) return *value;
  std::string list;
  for (const std::string& choice : choices) {
    if (*value == choice) return *value;
    list += (list.empty() ? "" : ", ") + choice;
  }
  impl_->violations->add({where(key), impl_->full(key), *value, "", list, "is not one of the choices"});
  return fallback;
}

std::optional<std::vector<double>> YamlMap::numbers(const std::string& key, int count, double lower, double upper,
                                                    const std::string& unit) {
  const YAML::Node list = node(key);
  if (!list.IsDefined()) return std::nullopt;
  if (!list.IsSequence() || (count > 0 && static_cast<int>(list.size()) != count)) {
    impl_->violations->add(where(key), impl_->full(key),
                           count > 0 ? "must be a list of " + std::to_string(count) + " numbers" : "must be a list of numbers");
    return std::nullopt;
  }
  std::vector<double> values;
  for (std::size_t i = 0; i < list.size(); ++i) {
    double value = 0;
    if (read_number(list[i], value) && value >= lower && value <= upper && std::isfinite(value)) {
      values.push_back(value);
    } else {
      impl_->violations->add({line_of(impl_->file, list[i]), impl_->full(key) + "[" + std::to_string(i) + "]",
                              scalar_text(list[i]), unit, bounds_text(lower, upper), "is out of bounds"});
    }
  }
  if (values.size() != list.size()) return std::nullopt;
  return values;
}

std::optional<YamlMap> YamlMap::map(const std::string& key) {
  const YAML::Node value = node(key);
  if (!value.IsDefined()) return std::nullopt;
  return YamlMap(value, impl_->file, impl_->full(key), *impl_->violations);
}

std::vector<YamlMap> YamlMap::maps(const std::string& key) {
  std::vector<YamlMap> list;
  const YAML::Node value = node(key);
  if (!value.IsDefined()) return list;
  if (!value.IsSequence()) {
    violation(key, "must be a list");
    return list;
  }
  for (std::size_t i = 0; i < value.size(); ++i) {
    list.emplace_back(value[i], impl_->file, impl_->full(key) + "[" + std::to_string(i) + "]", *impl_->violations);
  }
  return list;
}

std::vector<std::string> YamlMap::keys() const {
  std::vector<std::string> list;
  for (const auto& entry : impl_->node) list.push_back(entry.first.Scalar());
  return list;
}

void YamlMap::finish() {
  const std::vector<std::string> known(impl_->known.begin(), impl_->known.end());
  std::set<std::string> seen;
  for (const auto& entry : impl_->node) {
    const std::string key = entry.first.Scalar();
    const std::string place = line_of(impl_->file, entry.first);
    if (!seen.insert(key).second) impl_->violations->add(place, impl_->full(key), "is given twice");
    if (impl_->known.count(key)) continue;
    const std::string near = nearest_word(key, known);
    impl_->violations->add(place, impl_->full(key),
                           "is an unknown key" + (near.empty() ? std::string() : ": did you mean " + near + "?"));
  }
}

YAML::Node parse_yaml(const std::string& text, const std::string& name) {
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception& problem) {
    throw Error("not readable as YAML",
                {{name + ":" + std::to_string(problem.mark.line + 1), "", "", "", "", problem.msg}});
  }
}

YAML::Node load_yaml_file(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  if (!(file && text << file.rdbuf())) throw Error("cannot read " + path);
  return parse_yaml(text.str(), path);
}

}  // namespace binrig
