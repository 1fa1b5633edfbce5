// advice_study: do the captures that a diagnosis asks for tell the two effects apart?
//
//   advice_study --out lines.jsonl [--effects a,b --seeds N --first S --strength medium]
//
// Effects are hidden in a recording that says too little: every target faces the camera at one distance. Where the
// answer is that two effects look the same, the captures that it names are simulated by the same instrument, added to
// the recording, and the diagnosis is asked again. One line of JSON a recording; those that the file has already are
// not done again.
#include <fstream>
#include <set>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "bench/hidden_effects/study.h"
#include "core/parallel.h"
#include "core/pose.h"

namespace binrig::hidden {
namespace {

bench::Campaign one_distance() {
  bench::Campaign campaign(20251123);
  constexpr int frames = 4;
  campaign.plane("train", "plane", frames, 800);
  campaign.capture("train", "step", campaign.step(-12, 6, 800, 0.2), frames);
  campaign.capture("train", "chart", campaign.chart(800), frames);
  campaign.plane("test", "plane_2", frames, 800);
  campaign.capture("test", "step_2", campaign.step(14, -8, 800, 1.4), frames);
  campaign.capture("test", "chart_2", campaign.chart(800), frames);
  return campaign;
}

/// The campaign with one capture more, in train: like one of `forward`'s, its targets moved as the forward model moves
/// them.
bench::Campaign with_capture(bench::Campaign campaign, const SceneForwardModel& forward,
                             const AdvisedCapture& advised) {
  const CaptureInfo& like = forward.captures()[advised.capture];
  const auto& captures = campaign.captures();
  auto objects = std::find_if(captures.begin(), captures.end(), [&](const bench::CampaignCapture& c) {
                   return c.info.key() == like.key();
                 })->objects;
  Vector3 centroid = Vector3::Zero();
  for (const auto& object : objects) centroid += object.X_CO.translation() / static_cast<double>(objects.size());
  for (auto& object : objects) object.X_CO = small_motion(advised.where.pose, centroid) * object.X_CO;
  const std::string name = like.name + "_advised";
  campaign.capture("train", name.c_str(), objects, like.frames, like.target);
  return campaign;
}

const CandidateReport* first_confounded(const Diagnosis& diagnosis) {
  for (const CandidateReport& candidate : diagnosis.candidates)
    if (!candidate.confounded_with.empty()) return &candidate;
  return nullptr;
}

/// Something is named that is not said to look like one of the two; a third may turn out to be it.
bool tells_apart(const Diagnosis& diagnosis, const std::string& one, const std::string& other) {
  return !diagnosis.candidates.empty() &&
         std::ranges::none_of(diagnosis.candidates, [&](const CandidateReport& candidate) {
           const auto among = [&](const std::string& effect) {
             return candidate.effect == effect || std::ranges::count(candidate.confounded_with, effect) > 0;
           };
           return !candidate.confounded_with.empty() && among(one) && among(other);
         });
}

nlohmann::json answer_of(const Diagnosis& diagnosis) {
  nlohmann::json answer = {{"verdict", verdict_name(diagnosis.verdict)}, {"candidates", nlohmann::json::array()}};
  for (const Unexplained& rest : diagnosis.unexplained) answer["unexplained"].push_back({rest.segment, rest.ratio});
  for (const CandidateReport& candidate : diagnosis.candidates)
    answer["candidates"].push_back({{"effect", candidate.effect}, {"confounded_with", candidate.confounded_with}});
  return answer;
}

nlohmann::json study(const Case& c, const DiagnosisOptions& options, SimulationCache& cache) {
  constexpr int most_rounds = 3;
  nlohmann::json line = {{"key", c.key()}, {"effect", c.effects[0]}, {"rounds", nlohmann::json::array()}};
  bench::Campaign campaign = one_distance();
  std::string one, other;  // that looked the same in the round before
  for (int round = 0; round <= most_rounds; ++round) {
    const bench::SmallCampaign set(campaign);
    const Diagnosis diagnosis = ask(set.forward(), make_truth(set.forward(), c), cache, options);
    auto& entry = line["rounds"].emplace_back(answer_of(diagnosis));
    if (round > 0) entry["told_apart"] = tells_apart(diagnosis, one, other);
    const CandidateReport* pair = first_confounded(diagnosis);
    if (!pair || pair->would_separate.empty()) break;
    one = pair->effect, other = pair->told_from.front();
    entry["pair"] = {one, other};
    for (const AdvisedCapture& advised : pair->would_separate) {
      entry["advised"].push_back(advised.where_to);
      campaign = with_capture(std::move(campaign), set.forward(), advised);
    }
  }
  return line;
}

std::string rate(int hits, int of) {
  const auto [low, high] = exact_interval(hits, of);
  return fmt::format("{} of {} ({:.0f} .. {:.0f} %)", hits, of, 100 * low, 100 * high);
}

void print_summary(const std::vector<nlohmann::json>& lines) {
  const auto names = [](const nlohmann::json& round, const nlohmann::json& effect) {
    return !round["candidates"].empty() && round["candidates"][0]["effect"] == effect;
  };
  int looked_alike = 0, advised = 0, told_apart = 0, right = 0;
  for (const auto& line : lines) {
    const auto& rounds = line["rounds"];
    const auto& first = rounds[0];
    looked_alike += first["verdict"] == verdict_name(Verdict::confounded);
    if (rounds.size() == 1) continue;
    ++advised;
    told_apart += rounds[1]["told_apart"].get<bool>();
    right += names(rounds.back(), line["effect"]);
  }
  fmt::print("{} recordings; verdict confounded in {}, captures were advised in {}\n", lines.size(), looked_alike,
             advised);
  fmt::print(
      "with them, the two were told apart in {}; after up to three such rounds the hidden one came first in {}\n",
      rate(told_apart, advised), rate(right, advised));
}

int run(int argc, char** argv) {
  Plan plan;
  std::string out, strength = "medium";
  int threads = 0;
  CLI::App app{"Asks the diagnosis which captures it wants, simulates these, and asks again"};
  app.add_option("--out", out, "file of results, one JSON line a recording; recordings in it are not done again")
      ->required();
  app.add_option("--effects", plan.effects, "only these")->delimiter(',');
  app.add_option("--strength", strength, "weak, medium, strong")->check(CLI::IsMember({"weak", "medium", "strong"}));
  app.add_option("--seeds", plan.seeds, "recordings of each effect");
  app.add_option("--first", plan.first_seed, "seed of all recordings");
  app.add_option("--jobs", threads, "threads; default: all cores");
  CLI11_PARSE(app, argc, argv);
  if (threads > 0) set_jobs(threads);
  plan.strengths = {strength == "weak" ? Strength::weak : strength == "medium" ? Strength::medium : Strength::strong};
  std::vector<nlohmann::json> lines = read_lines(out);
  std::set<std::string> done;
  for (const auto& line : lines) done.insert(line["key"].get<std::string>());
  std::ofstream append(out, std::ios::app);
  const char* folder = std::getenv("BINRIG_CACHE");
  SimulationCache cache(folder ? folder : "", 8192, true);
  for (const Case& c : cases_of(plan)) {
    if (done.count(c.key())) continue;
    lines.push_back(study(c, {}, cache));
    append << lines.back().dump() << std::endl;
    fmt::print("{:<44} {}\n", c.key(), lines.back().dump());
    std::fflush(stdout);
  }
  print_summary(lines);
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
