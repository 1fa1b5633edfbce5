#include "diagnose/close_look.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include "diagnose/trace.h"

namespace binrig {
namespace {

/// Those that gain most among their neighbours, best first, and at least half of what the best does.
std::vector<LinearGain> peaks_of(std::vector<LinearGain> gains) {
  constexpr double close_behind = 0.5;
  constexpr std::size_t most = 4;
  std::vector<LinearGain> peaks;
  for (std::size_t k = 0; k < gains.size(); ++k) {
    const bool rises = k < 2 || gains[k].gain >= gains[k - 1].gain;  // the first one is no neighbour
    const bool falls = k == 0 || k + 1 == gains.size() || gains[k].gain >= gains[k + 1].gain;
    if (rises && falls) peaks.push_back(std::move(gains[k]));
  }
  std::ranges::sort(peaks, std::greater(), &LinearGain::gain);
  while (peaks.size() > most || peaks.back().gain < close_behind * peaks.front().gain) peaks.pop_back();
  return peaks;
}

/// The captures of most power, at most so many.
std::vector<int> strongest(const std::vector<double>& power, int most) {
  std::vector<int> captures(power.size());
  std::iota(captures.begin(), captures.end(), 0);
  std::ranges::stable_sort(captures, std::greater(), [&](int c) { return power[c]; });
  captures.resize(std::min<std::size_t>(most, std::ranges::count_if(power, [](double p) { return p > 0; })));
  return captures;
}

/// Places in the list of the third that gains most, in the order of the list.
std::vector<int> best_third(const std::vector<LinearGain>& gains) {
  std::vector<int> order(gains.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, std::greater(), [&](int k) { return gains[k].gain; });
  order.resize((order.size() + 2) / 3);
  std::ranges::sort(order);
  return order;
}

/// The one that leaves least when it is simulated.
LinearGain best_simulated(const Refiner& refiner, const Hypothesis& hypothesis, std::vector<LinearGain> peaks) {
  const EffectCatalogue& catalogue = refiner.experiment.forward().catalogue();
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < peaks.size() && peaks.size() > 1; ++k) {
    const SensorModel model = with_effect(refiner.rung.model, catalogue, hypothesis.effect, peaks[k].values);
    const double chi = registered_remainder(on_train(refiner), model).train;
    if (tracing()) {
      fmt::print(stderr, "  {} gain {:.0f} leaves {:.0f}:", hypothesis.effect, peaks[k].gain, chi);
      for (const auto& [name, value] : peaks[k].values) fmt::print(stderr, " {} {:.4g}", name, value);
      fmt::print(stderr, "\n");
    }
    if (chi < least) least = chi, best = k;
  }
  return std::move(peaks[best]);
}

/// Of the values that a step is tried at, the one that leaves least when it is simulated.
LinearGain best_step(const Refiner& refiner, const Hypothesis& hypothesis, LinearGain start) {
  const EffectCatalogue& catalogue = refiner.experiment.forward().catalogue();
  double least = std::numeric_limits<double>::infinity();
  for (const StrengthPath& path : hypothesis.paths)
    for (const Atom& atom : path.atoms) {
      const SensorModel model = with_effect(refiner.rung.model, catalogue, hypothesis.effect, atom.values);
      const double chi = remainder_of(on_train(refiner), model, refiner.rung.offsets, refiner.rung.place).train;
      if (tracing())
        fmt::print(stderr, "  {} {:.5g} leaves {:.0f}\n", hypothesis.effect,
                   atom.values.at(hypothesis.declaration->amplitude), chi);
      if (chi < least) least = chi, start.values = atom.values;
    }
  return start;
}

}  // namespace

LinearGain look_close_by(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start,
                         const std::vector<Signature>& signatures, std::optional<double> reach, double least) {
  const Experiment& experiment = refiner.experiment;
  const Rung& rung = refiner.rung;
  const int cols = experiment.nominal(0).depth_mm.cols;
  if (is_step(*hypothesis.declaration)) return best_step(refiner, hypothesis, start);
  const bool place = has_place(*hypothesis.declaration);
  if (!place && !has_period(*hypothesis.declaration)) return start;
  std::vector<double> power(experiment.layout().captures, 0);
  for (const Signature& signature : signatures)
    if (signature.hypothesis == start.hypothesis)
      add_power(experiment.layout(), rung.standard.difference(*signature.change), power);
  SignatureOptions few;
  few.seeds = 1;
  few.most_frames = 2;
  few.seed = refiner.seed + 20;
  few.shared = false;
  const auto gains = [&](std::vector<Hypothesis> close, int captures) {
    few.only = strongest(power, captures);
    return gains_about(experiment, rung, {std::move(close), {}}, few);
  };
  constexpr int scanned = 3, compared = 6;  // captures: a few targets do not tell a wave from some others
  LinearGain found;
  if (place) {
    found = gains({by_place(hypothesis, start.values, reach)}, scanned)[0];
  } else {
    std::vector<Hypothesis> periods = by_period(hypothesis, start.values, cols);
    std::vector<LinearGain> peaks = gains(periods, scanned);
    const double best = std::ranges::max(peaks, {}, &LinearGain::gain).gain;
    if (best * experiment.layout().captures < scanned * least) return start;  // nowhere does it change more
    const std::vector<int> hopeful = best_third(peaks);
    std::vector<Hypothesis> closer;
    for (const int k : hopeful) closer.push_back(std::move(periods[k]));
    for (LinearGain& peak : peaks) peak.gain = 0;
    const std::vector<LinearGain> again = gains(std::move(closer), compared);
    for (std::size_t k = 0; k < hopeful.size(); ++k) peaks[hopeful[k]] = again[k];
    peaks = peaks_of(std::move(peaks));
    if (peaks[0].gain <= 0) return start;
    // Maps are of cells of several pixels, which see a short period as a long one: what is nearest there is simulated.
    for (LinearGain& peak : peaks)
      peak = std::ranges::max(gains(by_period_near(hypothesis, peak.values, cols), compared), {}, &LinearGain::gain);
    found = best_simulated(refiner, hypothesis, std::move(peaks));
  }
  found.hypothesis = start.hypothesis;
  if (tracing()) {
    fmt::print(stderr, "  {}:", hypothesis.effect);
    for (const auto& [name, value] : found.values) fmt::print(stderr, " {} {:.4g}", name, value);
    fmt::print(stderr, " gain {:.0f} in {} captures\n", found.gain, few.only.size());
  }
  return found.gain > 0 ? found : start;
}

}  // namespace binrig
