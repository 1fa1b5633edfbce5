// hidden_effects: hides effects in recordings of the small campaign and asks the diagnosis which.
//
//   hidden_effects --out lines.jsonl [--seeds N --strength weak,medium,strong --effects a,b --none N --pairs N ...]
//   hidden_effects --set SET ...      the scenes, camera and uncertainties of a recording set instead of the small campaign's
//
// One line of JSON a recording is appended as soon as it is diagnosed; recordings that the file has already are not
// done again. Signatures are kept in the folder BINRIG_CACHE.
#include <sys/resource.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <set>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "app/forward.h"
#include "bench/hidden_effects/study.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/recording_writer.h"

namespace binrig::hidden {
namespace {

double cpu_seconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_utime.tv_sec + usage.ru_stime.tv_sec + 1e-6 * (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

/// Where recordings are made: the small campaign, or the scenes of a recording set.
class Scenes {
 public:
  explicit Scenes(const std::string& set) {
    if (set.empty()) {
      campaign_ = std::make_unique<bench::SmallCampaign>();
      return;
    }
    opened_ = open_forward_model(set);
    if (!dynamic_cast<const SceneForwardModel*>(opened_.model.get())) throw Error(set + " cannot be rendered");
  }
  const SceneForwardModel& forward() const {
    return campaign_ ? campaign_->forward() : dynamic_cast<const SceneForwardModel&>(*opened_.model);
  }

 private:
  std::unique_ptr<bench::SmallCampaign> campaign_;
  Forward opened_;
};

int run(int argc, char** argv) {
  Plan plan;
  std::string out, summary_out, table_out, set;
  std::vector<std::string> strengths{"medium"};
  bool improve = false;
  double time_limit_s = 1e9;
  int threads = 0;
  DiagnosisOptions options;
  CLI::App app{"Hides effects in recordings and asks the diagnosis which"};
  app.add_option("--out", out, "file of results, one JSON line a recording; recordings in it are not done again")
      ->required();
  app.add_option("--set", set, "recording set whose scenes are recorded anew; default: the small campaign");
  app.add_option("--summary", summary_out, "JSON of the summary");
  app.add_option("--table", table_out, "Markdown of all answers");
  app.add_option("--effects", plan.effects, "only these; also such as the catalogue does not have")->delimiter(',');
  app.add_option("--strength", strengths, "weak, medium, strong")
      ->delimiter(',')
      ->check(CLI::IsMember({"weak", "medium", "strong"}));
  app.add_option("--seeds", plan.seeds, "recordings of each effect and strength");
  app.add_option("--first", plan.first_seed, "seed of all recordings");
  app.add_option("--none", plan.none, "recordings with nothing hidden");
  app.add_option("--pairs", plan.pairs, "recordings with two effects, of the first strength");
  app.add_option("--outside", plan.outside, "recordings with effects that the catalogue does not have");
  app.add_flag("--improve", improve, "go on adding effects as `binrig improve` does");
  app.add_option("--time-limit", time_limit_s, "begin no recording after so many seconds");
  bool agreement = false;
  app.add_flag("--agreement", agreement,
               "no diagnosis: how far each hidden effect is from the catalogue's at the same values, by segment");
  app.add_option("--jobs", threads, "threads; default: all cores");
  CLI11_PARSE(app, argc, argv);
  if (threads > 0) set_jobs(threads);
  if (improve) options.most_effects = 6;
  plan.strengths.clear();
  for (const std::string& word : strengths)
    plan.strengths.push_back(word == "weak" ? Strength::weak : word == "medium" ? Strength::medium : Strength::strong);

  std::vector<nlohmann::json> lines = read_lines(out);
  std::set<std::string> done;
  for (const auto& line : lines) done.insert(line["key"].get<std::string>());
  std::ofstream append(out, std::ios::app);
  const Scenes scenes(set);
  const SceneForwardModel& forward = scenes.forward();
  const char* folder = std::getenv("BINRIG_CACHE");
  SimulationCache cache(folder ? folder : "", 8192, true);
  const auto began = std::chrono::steady_clock::now();
  std::vector<nlohmann::json> chosen;
  for (const Case& c : cases_of(plan)) {
    if (done.count(c.key())) {
      for (const auto& line : lines)
        if (line["key"] == c.key()) chosen.push_back(line);
      continue;
    }
    if (std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count() > time_limit_s) break;
    if (agreement) {
      fmt::print("{:<44}", c.key());
      for (const auto& [segment, square] : disagreement(forward, make_truth(forward, c), cache))
        fmt::print(" {} {:.2f}", segment, square);
      fmt::print("\n");
      std::fflush(stdout);
      continue;
    }
    const double cpu = cpu_seconds();
    nlohmann::json line;
    try {
      const Truth truth = make_truth(forward, c);
      const Diagnosis diagnosis = ask(forward, truth, cache, options);
      const double asked_s = cpu_seconds() - cpu;
      line = line_of(c, truth, traces_of(forward, truth), diagnosis, asked_s);
    } catch (const Error& error) {
      line = {{"key", c.key()}, {"kind", c.kind}, {"error", error.what()}};
    }
    append << line.dump() << std::endl;
    chosen.push_back(line);
    fmt::print("{:<44} {:<16} ", c.key(), line.value("verdict", "error"));
    if (line.contains("candidates"))
      for (const auto& candidate : line["candidates"]) fmt::print(" {}", candidate["effect"].get<std::string>());
    fmt::print("  ({:.1f} s CPU)\n", cpu_seconds() - cpu);
    std::fflush(stdout);
  }
  if (agreement) return 0;
  const nlohmann::json summary = summary_of(chosen);
  fmt::print("{}", summary_text(summary));
  if (!summary_out.empty()) write_file_atomically(summary_out, summary.dump(1) + "\n");
  if (!table_out.empty()) write_file_atomically(table_out, table_of(chosen));
  return 0;
}

}  // namespace
}  // namespace binrig::hidden

int main(int argc, char** argv) {
  try {
    return binrig::hidden::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
