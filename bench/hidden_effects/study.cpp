#include "bench/hidden_effects/study.h"

#include <algorithm>
#include <fstream>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "sim/effect.h"

namespace binrig::hidden {
namespace {

std::vector<std::string> catalogue_names() {
  std::vector<std::string> names;
  for (const EffectDeclaration* effect : effect_catalogue().all())
    if (!effect->user_defined) names.push_back(effect->name);
  return names;
}

RandomStream draws_of(const Case& c) { return RandomStream(hash_text(c.key())).child("hidden effects"); }

}  // namespace

std::string strength_name(Strength strength) {
  return strength == Strength::weak ? "weak" : strength == Strength::medium ? "medium" : "strong";
}

std::string Case::key() const {
  std::string text = kind;
  for (const std::string& effect : effects) text += "/" + effect;
  if (kind != "none") text += "/" + strength_name(strength);
  return text + "/" + std::to_string(seed);
}

std::vector<Case> cases_of(const Plan& plan) {
  const std::vector<std::string> names = plan.effects.empty() ? catalogue_names() : plan.effects;
  const std::vector<std::string> outsiders = outsider_names();
  if (plan.pairs > 0 && names.size() < 2) throw Error("pairs are drawn from the effects named: name at least two");
  std::vector<Case> cases;
  for (int seed = plan.first_seed; seed < plan.first_seed + plan.seeds; ++seed)
    for (const Strength strength : plan.strengths)
      for (const std::string& name : names) {
        const bool outside = std::find(outsiders.begin(), outsiders.end(), name) != outsiders.end();
        cases.push_back({outside ? "outside" : "one", {name}, strength, static_cast<std::uint64_t>(seed)});
      }
  for (int k = plan.first_seed; k < plan.first_seed + plan.none; ++k)
    cases.push_back({"none", {}, Strength::medium, static_cast<std::uint64_t>(k)});
  for (int k = plan.first_seed - 1; k < plan.first_seed - 1 + plan.pairs; ++k) {
    Dice dice(RandomStream(4711).child(static_cast<std::uint64_t>(k)));
    const auto a = static_cast<std::size_t>(dice.uniform() * names.size());
    auto b = static_cast<std::size_t>(dice.uniform() * (names.size() - 1));
    if (b >= a) ++b;
    cases.push_back({"pair", {names.at(a), names.at(b)}, plan.strengths.front(), static_cast<std::uint64_t>(k + 1)});
  }
  for (int k = 0; k < plan.outside; ++k)
    cases.push_back({"outside",
                     {outsiders[k % outsiders.size()]},
                     Strength::medium,
                     k / outsiders.size() + static_cast<std::uint64_t>(plan.first_seed)});
  return cases;
}

std::vector<nlohmann::json> read_lines(const std::string& path) {
  std::vector<nlohmann::json> lines;
  std::ifstream in(path);
  for (std::string text; std::getline(in, text);) {
    const auto line = nlohmann::json::parse(text, nullptr, false);
    if (!line.is_discarded()) lines.push_back(line);
  }
  return lines;
}

Truth make_truth(const SceneForwardModel& forward, const Case& c) {
  const RandomStream draws = draws_of(c);
  Truth truth;
  truth.instrument = bench::drawn_five_effect_model(draws.child("instrument").key());
  truth.start = bench::five_effect_model();
  for (const std::string& name : c.effects) {
    truth.hidden.push_back(draw_hidden(name, c.strength, draws));
    std::erase_if(truth.start.effects, [&](const EffectInstance& e) { return e.effect == name; });
  }
  truth.offsets = bench::drawn_offsets(forward, draws.child("registration").key());
  truth.frames_seed = draws.child("frames").key();
  truth.recording = record(forward, truth.instrument, truth.hidden, truth.offsets, truth.frames_seed);
  return truth;
}

std::vector<double> traces_of(const SceneForwardModel& forward, const Truth& truth) {
  std::vector<double> traces;
  for (std::size_t k = 0; k < truth.hidden.size(); ++k) {
    SensorModel instrument = truth.instrument;
    std::erase_if(instrument.effects, [&](const EffectInstance& e) { return e.effect == truth.hidden[k].name; });
    auto others = truth.hidden;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(k));
    const auto without = record(forward, instrument, others, truth.offsets, truth.frames_seed);
    double changed = 0, all = 0;
    for (std::size_t c = 0; c < without.size(); ++c)
      for (std::size_t i = 0; i < without[c].size(); ++i) {
        changed += cv::countNonZero(without[c][i].depth_mm != truth.recording[c][i].depth_mm);
        all += static_cast<double>(without[c][i].depth_mm.total());
      }
    traces.push_back(changed / all);
  }
  return traces;
}

Diagnosis ask(const SceneForwardModel& forward, const Truth& truth, SimulationCache& cache,
              const DiagnosisOptions& options) {
  return diagnose(
      forward, [&](int capture, int frame) { return truth.recording[capture][frame]; }, truth.start, cache, options);
}

std::map<std::string, double> disagreement(const SceneForwardModel& forward, const Truth& truth, SimulationCache& cache,
                                           int simulations) {
  SensorModel model = truth.instrument;
  for (const HiddenEffect& effect : truth.hidden) {
    std::erase_if(model.effects, [&](const EffectInstance& e) { return e.effect == effect.name; });
    add_effect(model, effect_catalogue(), effect.name, effect.values);
  }
  const Experiment experiment(forward, model, cache);
  std::vector<Trial> trials;
  for (int k = 0; k < simulations; ++k) trials.push_back({model, truth.offsets, static_cast<std::uint64_t>(k + 1)});
  const Standard standard(experiment.layout(), StatVector(experiment.layout().size, 0.f), experiment.simulate(trials));
  std::vector<std::string> unreadable;
  const Whitened y = standard.standardise(
      experiment.measure([&](int capture, int frame) { return truth.recording[capture][frame]; }, unreadable).all);
  std::map<std::string, double> square, count;
  for (const Block& block : experiment.layout().blocks)
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      if (standard.spread()[i] == 0) continue;
      square[segments()[block.segment].name] += y[i] * y[i];
      count[segments()[block.segment].name] += 1;
    }
  for (auto& [name, value] : square) value /= count[name];
  return square;
}

nlohmann::json line_of(const Case& c, const Truth& truth, const std::vector<double>& traces, const Diagnosis& diagnosis,
                       double cpu_s) {
  nlohmann::json line = {{"key", c.key()},
                         {"kind", c.kind},
                         {"effects", c.effects},
                         {"strength", strength_name(c.strength)},
                         {"seed", c.seed},
                         {"verdict", verdict_name(diagnosis.verdict)},
                         {"headline", diagnosis.headline},
                         {"cpu_s", cpu_s},
                         {"wall_s", diagnosis.seconds},
                         {"simulations", diagnosis.simulations}};
  for (std::size_t k = 0; k < truth.hidden.size(); ++k) {
    line["truth"][truth.hidden[k].name] = truth.hidden[k].values;
    line["trace"][truth.hidden[k].name] = traces.at(k);
  }
  line["candidates"] = nlohmann::json::array();
  for (const CandidateReport& candidate : diagnosis.candidates) {
    nlohmann::json entry = {{"effect", candidate.effect},
                            {"evidence", candidate.evidence},
                            {"train_gain", candidate.train_gain},
                            {"heldout_after", candidate.heldout_after},
                            {"p", candidate.p.p},
                            {"confounded_with", candidate.confounded_with}};
    for (const auto& [parameter, value] : candidate.parameters) {
      auto& number = entry["parameters"][parameter.name];
      number["value"] = value.value;
      if (value.ci95) number["ci95"] = *value.ci95;
    }
    line["candidates"].push_back(entry);
  }
  line["ladder"] = nlohmann::json::array();
  for (const LadderStep& step : diagnosis.ladder) {
    line["ladder"].push_back({{"added", step.added},
                              {"heldout", step.score.heldout},
                              {"proper", step.score.proper},
                              {"by_segment", step.score.by_segment}});
    line["band"] = {step.score.band_low, step.score.band_high};
  }
  line["unexplained"] = nlohmann::json::array();
  for (const Unexplained& rest : diagnosis.unexplained) line["unexplained"].push_back({rest.segment, rest.ratio});
  for (const Untested& effect : diagnosis.untested) line["untested"].push_back(effect.effect);
  auto ranking = diagnosis.ranking;
  std::stable_sort(ranking.begin(), ranking.end(),
                   [](const LinearRank& a, const LinearRank& b) { return a.gain - a.price > b.gain - b.price; });
  for (std::size_t k = 0; k < ranking.size(); ++k) {
    if (k < 6) line["ranking"].push_back({ranking[k].effect, ranking[k].gain, ranking[k].price});
    if (!c.effects.empty() && ranking[k].effect == c.effects[0]) line["linear_rank"] = k + 1;
  }
  line["warnings"] = diagnosis.warnings;
  return line;
}

}  // namespace binrig::hidden
