// How often the 95 % intervals of `calibrate` hold the truth: recordings of the small campaign are simulated from known
// parameters, calibrated from a start that lies elsewhere, and counted, effect by effect.
//
//   calibrate_coverage --out lines.jsonl [--seeds 40] [--first 1] [--effects depth_scale,...]
//   calibrate_coverage --out lines.jsonl --seeds 0      prints the table of what the file holds
//
// Every recording has its own noise, poses, intrinsics, unit maps and, but for the amplitude at medium strength, its
// own parameters. The model that is fitted has the noise of the sensor and the effect.
#include <chrono>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <set>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "bench/hidden_effects/recording.h"
#include "bench/hidden_effects/study.h"
#include "bench/support/small_campaign.h"
#include "core/progress.h"
#include "diagnose/calibration.h"
#include "diagnose/step_reader.h"
#include "sim/effect.h"

namespace binrig {
namespace {

using nlohmann::json;

// The train captures of the small campaign, less one of each pair of targets that are alike.
class FewCaptures : public ForwardModel {
 public:
  explicit FewCaptures(const ForwardModel& all) : all_(all), set_(all.set()) {
    const std::set<std::string> left_out{"plane_800", "tilt_x52", "step_turned"};
    for (std::size_t i = 0; i < all.captures().size(); ++i) {
      const CaptureInfo& info = all.captures()[i];
      if (info.split != "train" || left_out.count(info.name)) continue;
      index_.push_back(static_cast<int>(i));
      captures_.push_back(info);
    }
    set_.captures = captures_;
  }
  const EffectCatalogue& catalogue() const override { return all_.catalogue(); }
  const std::vector<CaptureInfo>& captures() const override { return captures_; }
  const SetInfo& set() const override { return set_; }
  cv::Mat region(int capture) const override { return all_.region(index_[capture]); }
  std::shared_ptr<const Channels> perfect(int capture, int frame, const Offset& offset, ChannelSet wanted,
                                          const SensorModel& model) const override {
    return all_.perfect(index_[capture], frame, offset, wanted, model);
  }
  void simulate(const SimulationRequest& request, const FrameSink& sink) const override {
    SimulationRequest inner = request;
    inner.capture = index_[request.capture];
    all_.simulate(inner, sink);
  }
  std::vector<std::pair<std::string, std::string>> inactive(const SensorModel& model) const override {
    return all_.inactive(model);
  }

 private:
  const ForwardModel& all_;
  SetInfo set_;
  std::vector<int> index_;
  std::vector<CaptureInfo> captures_;
};

struct Pair {
  SensorModel truth, start;
};

SensorModel noise_only() {
  return parse_sensor_model(
      "name: noise\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n  - spectral_noise: {}\n",
      "noise", effect_catalogue());
}

// Truth and start: amplitudes off by up to 40 %, other parameters by up to 15 % of their typical range, those without a
// smooth trace over it by up to 2 %, phases by up to 0.4 rad.
Pair draw(const EffectDeclaration& effect, std::uint64_t seed) {
  const RandomStream stream = RandomStream(seed).child(effect.name);
  const RandomStream dice = stream.child("values");
  std::uint64_t next = 0;
  const auto between = [&](double low, double high) { return low + (high - low) * dice.uniform(next++); };
  Pair pair{noise_only(), {}};
  auto& noise = pair.truth.effects[0].values;
  noise["sigma"].value = between(0.15, 0.4);
  noise["correlation_length"].value = between(0.5, 1.4);
  noise["white_share"].value = between(0.05, 0.3);
  pair.truth.unit_seed = dice.bits(next++);
  const hidden::HiddenEffect drawn = hidden::draw_hidden(effect.name, Strength::medium, stream.child("effect"));
  if (effect.name == "spectral_noise")
    for (const auto& [name, value] : drawn.values) noise[name].value = value;
  else
    add_effect(pair.truth, effect_catalogue(), effect.name, drawn.values);
  pair.start = pair.truth;
  pair.start.unit_seed = dice.bits(next++);
  for (auto& instance : pair.start.effects)
    for (const auto& spec : instance.declaration(effect_catalogue()).parameters) {
      double& value = instance.values[spec.name].value;
      const double off = between(-1, 1), width = spec.typical_high - spec.typical_low;
      if (spec.kind == ParameterKind::phase)
        value += 0.4 * off;
      else if (spec.kind == ParameterKind::integer)
        value += std::round(1.2 * off);
      else if (!spec.interpolate)
        value *= std::exp(0.02 * off);
      else if (spec.name == instance.declaration(effect_catalogue()).amplitude && spec.typical_low > 0 &&
               spec.neutral == 0.0)
        value *= std::exp(0.35 * off);
      else if (spec.log_scaled)
        value *= std::exp(0.15 * off * std::log(spec.typical_high / spec.typical_low));
      else
        value += 0.15 * off * width;
      value = std::clamp(value, spec.lower, spec.upper);
      if (spec.kind == ParameterKind::phase) value = std::clamp(value, -3.14, 3.14);
    }
  return pair;
}

json run(const Experiment& experiment, const EffectDeclaration& effect, std::uint64_t seed) {
  const Pair pair = draw(effect, seed);
  const std::uint64_t key = mix_keys(hash_text(effect.name), seed);  // recordings of two effects share no draw
  const auto offsets = bench::drawn_offsets(experiment.forward(), key);
  const Trial recording{pair.truth, offsets, mix_keys(key, 1), Part::train};
  Measurement data{experiment.simulate({recording})[0], {}};
  for (const int most : {2, 3})
    for (bool shorten : {false, true}) {
      Trial shortened = recording;
      shortened.most_frames = most;
      shortened.shorten_series = shorten;
      data.few[{most, shorten}] = experiment.simulate({shortened})[0];
    }
  CalibrationOptions options;
  const SensorModel usual = without_steps(pair.start, effect_catalogue());
  options.seen = seen_steps(simulated_values(experiment, pair.truth), simulated_values(experiment, usual));
  options.seed = key % 1000000;
  options.provenance = "simulated recording";
  const std::clock_t began = std::clock();
  const Calibration found = calibrate(experiment, data, pair.start, options);
  json line{{"effect", effect.name},
            {"seed", seed},
            {"cpu_s", static_cast<double>(std::clock() - began) / CLOCKS_PER_SEC},
            {"dispersion", found.dispersion},
            {"converged", found.converged}};
  for (const auto& p : found.parameters) {
    const EffectInstance* instance = pair.truth.find(p.id);
    const double truth = instance->value(p.name);
    json entry{{"id", p.id},
               {"parameter", p.name},
               {"truth", truth},
               {"start", p.before},
               {"value", p.value},
               {"determined", p.determined()},
               {"narrowing", p.narrowing},
               {"amplitude", instance->effect == effect.name && p.name == effect.amplitude}};
    if (p.ci95) {
      const auto& spec = *instance->declaration(effect_catalogue()).parameter(p.name);
      bool held = truth >= (*p.ci95)[0] - 1e-9 && truth <= (*p.ci95)[1] + 1e-9;
      if (spec.kind == ParameterKind::phase)
        for (double turn : {-2 * M_PI, 2 * M_PI}) held |= truth + turn >= (*p.ci95)[0] && truth + turn <= (*p.ci95)[1];
      entry["ci95"] = *p.ci95;
      entry["held"] = held;
    }
    line["parameters"].push_back(entry);
  }
  return line;
}

void table(const std::vector<json>& lines) {
  struct Count {
    int recordings = 0, amplitude = 0, amplitude_held = 0, other = 0, other_held = 0, open = 0, converged = 0;
    double cpu = 0, width = 0;
  };
  std::map<std::string, Count> counts;
  Count all;
  for (const auto& line : lines) {
    Count& c = counts[line["effect"]];
    for (Count* to : {&c, &all}) {
      ++to->recordings;
      to->cpu += line["cpu_s"].get<double>();
      to->converged += line["converged"].get<bool>();
      for (const auto& p : line["parameters"]) {
        const bool noise = p["id"] == "spectral_noise" && line["effect"] != "spectral_noise";
        if (!p.contains("held")) {
          to->open += !noise;
          continue;
        }
        const bool held = p["held"];
        (p["amplitude"].get<bool>() ? to->amplitude : to->other) += 1;
        (p["amplitude"].get<bool>() ? to->amplitude_held : to->other_held) += held;
      }
    }
  }
  fmt::print("{:<24}{:>11}{:>14}{:>10}{:>22}{:>13}{:>9}\n", "effect", "recordings", "amplitude", "", "other parameters",
             "left open", "CPU s");
  const auto row = [](const std::string& name, const Count& c) {
    fmt::print("{:<24}{:>11}{:>10} of {:<4}{:>5.0f} %{:>10} of {:<5}{:>4.0f} %{:>10}{:>10.1f}\n", name, c.recordings,
               c.amplitude_held, c.amplitude, c.amplitude ? 100.0 * c.amplitude_held / c.amplitude : 0, c.other_held,
               c.other, c.other ? 100.0 * c.other_held / c.other : 0, c.open, c.cpu / c.recordings);
  };
  for (const auto& [name, count] : counts) row(name, count);
  row("all", all);
  const auto [low, high] = hidden::exact_interval(all.amplitude_held, all.amplitude);
  fmt::print("pooled over all effects' amplitudes: {:.1f} % ({:.1f} .. {:.1f})\n",
             100.0 * all.amplitude_held / std::max(1, all.amplitude), 100 * low, 100 * high);
  const auto [low2, high2] = hidden::exact_interval(all.amplitude_held + all.other_held, all.amplitude + all.other);
  fmt::print("over all fitted parameters: {:.1f} % ({:.1f} .. {:.1f})\n",
             100.0 * (all.amplitude_held + all.other_held) / std::max(1, all.amplitude + all.other), 100 * low2,
             100 * high2);
}

}  // namespace
}  // namespace binrig

int main(int argc, char** argv) {
  using namespace binrig;
  CLI::App app("coverage of calibrate's intervals");
  std::string out;
  int seeds = 40, first = 1;
  std::vector<std::string> effects;
  app.add_option("--out", out, "file of results, one JSON object a line; what it holds is not done again")->required();
  app.add_option("--seeds", seeds, "recordings of each effect");
  app.add_option("--first", first, "seed of the first");
  app.add_option("--effects", effects, "only these")->delimiter(',');
  CLI11_PARSE(app, argc, argv);
  Progress::silence();
  std::vector<nlohmann::json> lines;
  std::set<std::pair<std::string, int>> done;
  {
    std::ifstream file(out);
    for (std::string text; std::getline(file, text);) {
      lines.push_back(nlohmann::json::parse(text));
      done.emplace(lines.back()["effect"].get<std::string>(), lines.back()["seed"].get<int>());
    }
  }
  if (seeds > 0) {
    const bench::SmallCampaign campaign;
    SimulationCache cache("");
    const FewCaptures captures(campaign.forward());
    const Experiment experiment(captures, noise_only(), cache);
    std::ofstream file(out, std::ios::app);
    for (int seed = first; seed < first + seeds; ++seed)
      for (const EffectDeclaration* effect : effect_catalogue().all()) {
        if (effect->user_defined || done.count({effect->name, seed})) continue;
        if (!effects.empty() && std::find(effects.begin(), effects.end(), effect->name) == effects.end()) continue;
        lines.push_back(run(experiment, *effect, static_cast<std::uint64_t>(seed)));
        file << lines.back().dump() << std::endl;
      }
  }
  table(lines);
}
