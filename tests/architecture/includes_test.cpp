// Who may include whom (docs/design.md). Every #include "folder/..." of the source tree is held against the table.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>

namespace {

namespace fs = std::filesystem;

// A folder may include itself and these; "all" = everything. Single headers are named in full.
const std::map<std::string, std::set<std::string>> allowed{
    {"core", {}},
    {"report", {"core"}},
    {"hw", {"core"}},
    {"sim", {"core"}},
    {"sim/effects", {"core", "sim/effect.h"}},
    {"sim/dot_pattern", {"core", "sim/renderer.h", "sim/mesh.h"}},
    {"compare", {"core", "report"}},
    {"calib", {"core", "compare"}},
    {"diagnose", {"core", "compare", "calib", "report"}},
    {"eval", {"core", "sim", "report"}},
    {"estimator", {"core", "sim"}},
    {"app", {"all"}},
    {"tests", {"all"}},
    {"bench", {"all"}},
};
// sim includes its own rooms, too.
const std::set<std::string> rooms_of_sim{"sim/effects", "sim/dot_pattern"};

const fs::path root = BINRIG_SOURCE_DIR;

std::string room_of(const std::string& path) {
  const std::string folder = fs::path(path).parent_path().string();
  for (const std::string& room : rooms_of_sim) {
    if (folder == room) return room;
  }
  return path.substr(0, path.find('/'));
}

bool may_include(const std::string& from, const std::string& header) {
  const std::string room = room_of(from), target = room_of(header);
  const auto entry = allowed.find(room);
  if (entry == allowed.end()) return false;
  if (room == target || entry->second.count("all") || entry->second.count(target) || entry->second.count(header))
    return true;
  return room == "sim" && rooms_of_sim.count(target);
}

template <typename Visit>
void for_each_line(Visit visit) {
  for (const auto& [folder, unused] : allowed) {
    if (!fs::is_directory(root / folder) || folder.find('/') != std::string::npos) continue;
    for (const auto& file : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = file.path().extension().string();
      if (extension != ".h" && extension != ".cpp") continue;
      const std::string name = fs::relative(file.path(), root).string();
      std::ifstream in(file.path());
      int number = 0;
      for (std::string line; std::getline(in, line);) visit(name, ++number, line);
    }
  }
}

template <typename Visit>
void for_each_include(Visit visit) {
  const std::regex include(R"re(^\s*#\s*include\s*(["<])([^">]+)[">])re");
  for_each_line([&](const std::string& file, int number, const std::string& line) {
    std::smatch match;
    if (std::regex_search(line, match, include)) visit(file, number, match[2].str(), match[1].str() == "\"");
  });
}

TEST(Architecture, EveryIncludeIsInTheTable) {
  int seen = 0;
  for_each_include([&](const std::string& file, int line, const std::string& header, bool ours) {
    if (!ours || header.find('/') == std::string::npos) return;
    ++seen;
    EXPECT_TRUE(may_include(file, header)) << file << ":" << line << " must not include " << header;
  });
  EXPECT_GT(seen, 200);
}

TEST(Architecture, TheTableRefusesWhatItShould) {
  EXPECT_FALSE(may_include("core/frame.cpp", "sim/effect.h"));
  EXPECT_FALSE(may_include("compare/x.cpp", "sim/sensor.h"));
  EXPECT_FALSE(may_include("diagnose/x.cpp", "sim/effect.h"));
  EXPECT_FALSE(may_include("sim/effects/x.cpp", "sim/sensor.h"));
  EXPECT_FALSE(may_include("sim/dot_pattern/x.cpp", "sim/effect.h"));
  EXPECT_TRUE(may_include("sim/effects/x.cpp", "sim/effect.h"));
  EXPECT_TRUE(may_include("app/open.cpp", "hw/replay_source.h"));
}

TEST(Architecture, ThirdPartyHeadersStayOutOfOurHeaders) {
  const std::regex fine(R"(^(Eigen/.*|opencv2/core/mat\.hpp|nlohmann/json_fwd\.hpp|[a-z_]+|[a-z_]+\.h)$)");
  const std::set<std::string> internal{"core/recording_files.h"};  // not a public header
  for_each_include([&](const std::string& file, int line, const std::string& header, bool ours) {
    if (ours || fs::path(file).extension() != ".h" || file.rfind("tests/", 0) == 0 || internal.count(file)) return;
    EXPECT_TRUE(std::regex_match(header, fine)) << file << ":" << line << " includes <" << header << ">";
  });
}

// Two types of one name share their destructors and copies: the linker keeps one of each.
TEST(Architecture, OneNameIsOneTypeInAllHeaders) {
  const std::regex space(R"(^namespace ([\w:]+) \{)"), type(R"(^(struct|class|enum class) (\w+)[^;]*\{)");
  std::map<std::string, std::string> declared;  // where
  std::string file_now, space_now;
  for_each_line([&](const std::string& file, int number, const std::string& line) {
    if (fs::path(file).extension() != ".h") return;
    if (file != file_now) file_now = file, space_now.clear();
    std::smatch match;
    if (std::regex_search(line, match, space)) space_now = match[1];
    if (!std::regex_search(line, match, type)) return;
    const auto [other, is_new] = declared.emplace(space_now + "::" + match[2].str(), file);
    EXPECT_TRUE(is_new) << file << ":" << number << " declares " << other->first << " as " << other->second << " does";
  });
  EXPECT_GT(declared.size(), 100u);
}

// The diagnosis knows no effect by name: none of their names may stand in diagnose/, not even in a comment.
TEST(Architecture, TheDiagnosisNamesNoEffect) {
  std::set<std::string> names;
  for (const auto& file : fs::directory_iterator(root / "sim/effects")) {
    if (file.path().extension() == ".cpp") names.insert(file.path().stem().string());
  }
  ASSERT_FALSE(names.empty());
  const std::set<std::string> everyday{"formula", "dust", "latency", "vibration",
                                       "smoothing"};  // words of the language
  for (const auto& file : fs::recursive_directory_iterator(root / "diagnose")) {
    std::ifstream in(file.path());
    int number = 0;
    for (std::string line; std::getline(in, line);) {
      ++number;
      for (const std::string& name : names) {
        const bool quoted = line.find("\"" + name + "\"") != std::string::npos;
        const bool named = line.find(name) != std::string::npos && !everyday.count(name);
        EXPECT_FALSE(quoted || named) << file.path().filename() << ":" << number << " names " << name;
      }
    }
  }
}

}  // namespace
