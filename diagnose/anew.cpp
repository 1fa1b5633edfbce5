#include "diagnose/anew.h"

#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include "core/parallel.h"
#include "diagnose/close_look.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double right_step = 0.9;  // of chi without it, that the right one leaves at most

/// Where a hypothesis comes nearest before it is fitted.
struct Start {
  int hypothesis = 0;
  std::map<std::string, double> values;
  double chi = 0;
  double gain = 0;  // of chi
};

}  // namespace

std::vector<Anew> look_anew(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                            const Measurement& measured, const Beginning& from, const Hypotheses& hypotheses, int known,
                            int most, std::uint64_t seed, const std::vector<double>& least_share) {
  const auto& [given, signatures, simulations] = from;
  constexpr int frames = 3;
  const Layout& layout = experiment.layout();
  const EffectCatalogue& catalogue = experiment.forward().catalogue();
  const StatVector& few = measured.at(frames, false);
  const Standard standard(layout, few, simulations);
  const Whitened data = standard.linear(few);
  auto rows = motion_rows(layout, standard, motions);
  const Metric metric(layout, Part::train, rows);

  FitOptions derivatives;
  derivatives.iterations = 0;
  derivatives.most_frames = frames;
  derivatives.seed = seed;
  const Fit own =
      fit_model(experiment, standard, metric, data, given, fit_parameters(given, catalogue), {}, derivatives);
  for (std::size_t p = 0; p < own.parameters.size(); ++p) {
    rows.push_back({own.slopes[p], -1});
    for (float& v : rows.back().change) v *= static_cast<float>(own.parameters[p].prior_sigma);
  }
  const Metric free(layout, Part::train, rows);

  const auto path_of = [&](std::size_t s) -> const StrengthPath& {
    return hypotheses.tested[signatures[s].hypothesis].paths[signatures[s].path];
  };
  std::vector<double> chi(signatures.size());
  std::vector<char> turned(signatures.size(), 0);  // the other sign is nearer
  parallel_for(static_cast<int>(signatures.size()), [&](int s) {
    const Whitened change = standard.difference(*signatures[s].change);
    const auto left = [&](float sign) {
      Whitened rest = data;
      for (std::size_t i = 0; i < rest.size(); ++i) rest[i] -= sign * change[i];
      return free.explain(rest).chi;
    };
    chi[s] = left(1);
    if (!path_of(s).mirror) return;
    const double other = left(-1);
    if (other < chi[s]) chi[s] = other, turned[s] = 1;
  });
  std::map<int, std::size_t> best;  // signature by hypothesis
  for (std::size_t s = 0; s < signatures.size(); ++s) {
    if (hypotheses.tested[signatures[s].hypothesis].declaration->per_unit_map)
      continue;  // of one unit, not of this one
    const auto [at, fresh] = best.try_emplace(signatures[s].hypothesis, s);
    if (!fresh && chi[s] < chi[at->second]) at->second = s;
  }
  Rung as_given;
  as_given.model = given;
  as_given.standard = standard;
  as_given.train = free;
  Explained explained = free.explain(data);
  as_given.rest = std::move(explained.rest);
  as_given.nuisances = std::move(explained.values);
  std::vector<Start> starts;
  for (const auto& [h, s] : best) {
    starts.push_back({h, path_of(s).atoms[signatures[s].atom].values, chi[s], explained.chi - chi[s]});
    if (turned[s]) starts.back().values[hypotheses.tested[h].declaration->amplitude] *= -1;
  }

  // Signatures know few periods and steps. About the fitted model others may look right than about the given one.
  const Refiner refiner{experiment, motions, as_given, measured, 2, seed + 1, Part::train, frames};
  const double without = remainder_of(refiner, given, {}, {}).train;
  const auto is_step_of = [&](const Start& start) { return is_step(*hypotheses.tested[start.hypothesis].declaration); };
  const auto try_at = [&](Start& start, const std::map<std::string, double>& values) {
    const std::string& effect = hypotheses.tested[start.hypothesis].effect;
    const double its = remainder_of(refiner, with_effect(given, catalogue, effect, values), {}, {}).train;
    if (is_step_of(start) || its < start.chi) start = {start.hypothesis, values, its, without - its};
  };
  // What explains too little is no way to what explains more.
  const auto least = [&](const Start& start) {
    return least_share.empty() ? -std::numeric_limits<double>::infinity()
                               : least_share[start.hypothesis] * without;
  };
  for (Start& start : starts) {
    const Hypothesis& hypothesis = hypotheses.tested[start.hypothesis];
    if (!is_step_of(start) && !has_period(*hypothesis.declaration)) continue;
    const LinearGain from_here{start.hypothesis, 0, start.values};
    try_at(start, look_close_by(refiner, hypothesis, from_here, signatures, {}, least(start)).values);
  }
  if (!least_share.empty()) {
    // Signatures are of two strengths. What the linear view makes of one between is to prove it.
    const auto linear = Ranking(experiment, as_given, hypotheses, signatures).gains(as_given.rest, as_given.nuisances);
    for (Start& start : starts)
      if (!is_step_of(start) && start.gain < least(start) && linear[start.hypothesis].gain >= least(start))
        try_at(start, linear[start.hypothesis].values);
  }
  std::erase_if(starts, [&](const Start& start) {
    return is_step_of(start) ? start.chi > right_step * without : start.gain < least(start);
  });
  std::sort(starts.begin(), starts.end(), [](const Start& a, const Start& b) { return a.chi < b.chi; });

  std::vector<Anew> result;
  if (!starts.empty() && starts[0].hypothesis == known) return result;
  for (const Start& start : starts) {
    const Hypothesis& hypothesis = hypotheses.tested[start.hypothesis];
    if (tracing()) fmt::print(stderr, "  anew: {} chi {:.0f} of {:.0f}\n", hypothesis.effect, start.chi, without);
    if (static_cast<int>(result.size()) >= most) break;
    SensorModel model = given;
    Anew anew;
    anew.hypothesis = start.hypothesis;
    anew.id = add_effect(model, catalogue, hypothesis.effect, start.values).id;
    FitOptions options;
    options.most_frames = frames;
    options.iterations = 12;
    options.converged = 20;
    options.converged_far_off = 0.01;
    options.seed = seed;
    if (!hypothesis.seen_at(start.values)) options.scan_ids = {anew.id};
    options.scan_ranges_of = anew.id;
    options.place.assign(motions.size(), 0);
    options.motions = &motions;
    anew.fit = fit_model(experiment, standard, metric, data, model, fit_parameters(model, catalogue), {}, options);
    result.push_back(std::move(anew));
  }
  return result;
}

}  // namespace binrig
