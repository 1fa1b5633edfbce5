// docs/effects.md is written from the declarations; this fails when a declaration has changed since.
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "sim/effect.h"

namespace binrig {
namespace {

const std::filesystem::path docs = std::filesystem::path(BINRIG_SOURCE_DIR) / "docs";

TEST(EffectsPage, SaysWhatTheDeclarationsSay) {
  std::stringstream stream;
  stream << std::ifstream(docs / "effects.md").rdbuf();
  const std::string page = stream.str();
  const auto expect = [&](const std::string& words, const std::string& effect) {
    EXPECT_NE(page.find(words), std::string::npos)
        << effect << ": \"" << words << "\" is missing; write the page anew: binrig effects --markdown docs";
  };
  for (const EffectDeclaration* effect : effect_catalogue().all()) {
    expect("### " + effect->name + "\n\n" + effect->phenomenon, effect->name);
    expect("    " + effect->formula, effect->name);
    expect(effect->citation, effect->name);
    expect(effect->deviation, effect->name);
    expect(effect->revealed_by, effect->name);
    for (const ParameterSpec& p : effect->parameters) {
      expect(number_text(p.lower) + " .. " + number_text(p.upper), effect->name + "." + p.name);
      expect(p.meaning, effect->name + "." + p.name);
    }
  }
}

TEST(EffectsPage, EveryEffectHasAPictureAndTogetherTheyAreSmall) {
  std::uintmax_t bytes = 0;
  for (const EffectDeclaration* effect : effect_catalogue().all()) {
    const auto path = docs / "effects" / (effect->name + ".png");
    ASSERT_TRUE(std::filesystem::exists(path)) << path;
    EXPECT_FALSE(cv::imread(path.string()).empty()) << path;
    bytes += std::filesystem::file_size(path);
  }
  EXPECT_LT(bytes, 4'000'000u);
}

}  // namespace
}  // namespace binrig
