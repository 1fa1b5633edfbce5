#include "app/model_files.h"

#include <filesystem>

#include "sim/effect.h"

namespace binrig {

void rebase_files(SensorModel& model, const std::string& out) {
  const auto from = std::filesystem::absolute(model.file).parent_path();
  const auto to = std::filesystem::absolute(out).parent_path();
  for (auto& instance : model.effects)
    for (auto& [name, value] : instance.options) {
      const OptionSpec* spec = instance.declaration(effect_catalogue()).option(name);
      if (spec == nullptr || !spec->is_file || value.empty() || std::filesystem::path(value).is_absolute()) continue;
      value = std::filesystem::proximate(from / value, to).string();
    }
  model.file = out;
}

}  // namespace binrig
