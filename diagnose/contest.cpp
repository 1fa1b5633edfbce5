#include "diagnose/contest.h"

#include <optional>

#include <fmt/format.h>

#include "diagnose/choice.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr std::size_t most_runners_up = 3;  // that are fitted with everything beside the best

}  // namespace

/// Noise may have taken the part of a ring in its spectrum, the lens that of a wrong focal length: no slope leads back.
Rung Contest::with_best(const Rung& rung, const Refined& best, const RungOptions& fit) const {
  Rung next = adding_.to(rung, best, fit);
  auto left = unexplained(experiment_.layout(), next);
  const auto take_if_better = [&](std::optional<Rung> other) {
    if (!other) return;
    auto its = unexplained(experiment_.layout(), *other);
    if (its.size() < left.size()) next = std::move(*other), left = std::move(its);
  };
  const auto lens_is_off = [&] { return left.contains({"intrinsics", true}); };
  const Hypothesis& hypothesis = candidates_.hypothesis(best);
  if (lens_is_off()) take_if_better(adding_.lens_put_back(next, best.id, fit));
  if (has_tone(*hypothesis.declaration) ? !left.empty() : lens_is_off())
    take_if_better(adding_.to_the_given(rung, hypothesis, fit));
  return next;
}

Chosen Contest::decide(const Rung& rung, const std::vector<const Refined*>& worthy,
                       const std::vector<Signature>& signatures, const RungOptions& fit) const {
  const Refined* best = worthy[0];
  Chosen chosen{best, with_best(rung, *best, fit), {}};
  std::set<std::string> tried{best->effect};
  for (const Refined* other : worthy) {
    if (tried.size() > most_runners_up) break;
    if (tried.contains(other->effect)) continue;
    // Beside bent parameters, who gains less by itself may be the right one: asked if what the best one leaves shows
    // that it is not. And where that was so, gains beside them are no reason to call a third one as good.
    const bool misled = chosen.best != best && confounded(rung, *chosen.best, *other);
    const bool may_be_right = misled || comes_close(*best, *other, options_) ||
                              (chosen.rung.dispersion > leaves_something && is_rival(*best, *other, options_));
    if (!may_be_right) continue;
    if (rung.dispersion > many_missing && !standing_beside(rung, *best, {other}).empty()) continue;
    if (tried.size() > 1 && !misled && unexplained(experiment_.layout(), chosen.rung).empty()) continue;
    tried.insert(other->effect);
    meet(chosen, *other, adding_.to(rung, *other, fit), signatures);
  }
  return chosen;
}

/// Which of the two stays: `chosen`, or what was added in its place.
void Contest::meet(Chosen& chosen, const Refined& runner_up, Rung with,
                   const std::vector<Signature>& signatures) const {
  const auto contender = [&](const Rung& rung, const Refined& added, const Refined& beside) {
    return Contender{rung.dispersion, proper_score(experiment_.layout(), rung),
                     [&] { return left_for(beside, rung, signatures); },
                     [&] { return unexplained_excess(goodness_of_fit(experiment_.layout(), rung)); },
                     static_cast<int>(added.model.find(added.id)->values.size())};
  };
  const Contender first = contender(chosen.rung, *chosen.best, runner_up),
                  follower = contender(with, runner_up, *chosen.best);
  if (tracing())
    fmt::print(stderr, "  {} dispersion {:.2f} proper {:.4f}, {} {:.2f} {:.4f}\n", chosen.best->effect,
               first.dispersion, first.proper_score, runner_up.effect, follower.dispersion, follower.proper_score);
  const Choice choice = choose(first, follower, options_.least_train_gain);
  if (choice.clear) chosen.beaten.insert(choice.runner_up ? chosen.best->effect : runner_up.effect);
  if (choice.runner_up) chosen.best = &runner_up, chosen.rung = std::move(with);
}

/// What the signatures of a hypothesis gain of what a rung leaves, less what chance makes of them.
double Contest::left_for(const Refined& refined, const Rung& rung, const std::vector<Signature>& signatures) const {
  Hypotheses one;
  std::vector<Signature> its;
  one.tested.push_back(candidates_.hypothesis(refined));
  for (const Signature& signature : signatures)
    if (signature.hypothesis == refined.hypothesis) its.push_back(signature), its.back().hypothesis = 0;
  return Ranking(experiment_, rung, one, its).gains(rung.rest, rung.nuisances)[0].gain / rung.dispersion -
         refined.price;
}

}  // namespace binrig
