#include "diagnose/mask_fit.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include <fmt/format.h>
#include <opencv2/core/optim.hpp>

#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int simulations = 8, short_frames = 3;
constexpr int most_evaluations = 40;
constexpr double worth_it = 4;  // of a proper score, summed: two standard deviations of one parameter
const std::string what_for = "fitting masks";

/// The proper score of a few captures, summed, as a function of one effect's parameters on the scales of their fits.
class MaskScore : public cv::MinProblemSolver::Function {
 public:
  MaskScore(const Experiment& experiment, const Measurement& measured, const Rung& rung,
            std::vector<FitParameter> parameters, std::vector<int> captures, std::uint64_t seed)
      : experiment_(experiment),
        measured_(measured),
        rung_(rung),
        parameters_(std::move(parameters)),
        captures_(std::move(captures)),
        seed_(seed) {}

  int getDims() const override { return static_cast<int>(parameters_.size()); }
  double calc(const double* x) const override { return of(model_at(x)); }

  SensorModel model_at(const double* x) const {
    return with_values(rung_.model, parameters_, Eigen::Map<const Eigen::VectorXd>(x, getDims()));
  }

  double of(const SensorModel& model) const {
    std::vector<Trial> trials;
    for (int k = 0; k < simulations; ++k)
      trials.push_back(
          {model, rung_.offsets, seed_ + static_cast<std::uint64_t>(k), Part::train, short_frames, true, captures_});
    const StatVector& few = measured_.at(short_frames, true);
    const Standard standard(experiment_.layout(), few, experiment_.simulate(trials, what_for));
    const Whitened rest = standard.standardise(few);
    double score = 0;
    for (std::size_t i = 0; i < rest.size(); ++i)
      if (const float s = standard.spread()[i]; s > 0)
        score += static_cast<double>(rest[i]) * rest[i] + 2 * std::log(s);
    return score;
  }

 private:
  const Experiment& experiment_;
  const Measurement& measured_;
  const Rung& rung_;
  const std::vector<FitParameter> parameters_;
  const std::vector<int> captures_;
  const std::uint64_t seed_;
};

std::vector<int> either(const std::vector<int>& a, const std::vector<int>& b) {
  std::vector<int> result;
  std::ranges::set_union(a, b, std::back_inserter(result));
  return result;
}

std::vector<FitParameter> parameters_of(const Rung& rung, const std::string& id) {
  std::vector<FitParameter> result;
  for (const FitParameter& p : rung.fit.parameters)
    if (p.id == id && !p.circular && !p.narrow) result.push_back(p);
  return result;
}

/// The model with one effect's parameters in the valley where the user put them; none if the rung's are no worse.
std::optional<SensorModel> with_mask(const Rung& rung, const EffectInstance& given,
                                     const std::vector<FitParameter>& parameters, const cv::Ptr<MaskScore>& score) {
  const int n = static_cast<int>(parameters.size());
  cv::Mat_<double> x(1, n), step(1, n);
  for (int p = 0; p < n; ++p) {
    x(p) = parameters[p].scaled(given.value(parameters[p].name));
    step(p) = parameters[p].longest;
  }
  const double before = score->of(rung.model);
  // Its epsilon ends it where the simplex is small or level, whichever comes first.
  const cv::TermCriteria until(cv::TermCriteria::MAX_ITER + cv::TermCriteria::EPS, most_evaluations, 0.003);
  const double after = cv::DownhillSolver::create(score, step, until)->minimize(x);
  const SensorModel model = score->model_at(x[0]);
  if (tracing()) {
    fmt::print(stderr, "  mask's proper score {:.0f} -> {:.0f}:", before, after);
    for (const FitParameter& p : parameters) fmt::print(stderr, " {} {:.4g}", p.name, model.find(p.id)->value(p.name));
    fmt::print(stderr, "\n");
  }
  if (after > before - worth_it) return std::nullopt;
  return model;
}

}  // namespace

bool fit_masks(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
               const SensorModel& given, const RungOptions& options, Rung& rung) {
  const Layout& layout = experiment.layout();
  const auto out = captures_that_stand_out(layout, rung);
  if (out.empty()) return false;
  const auto simulated = [&](const SensorModel& model) {
    return experiment.simulate({{model, rung.offsets, options.seed + 7000}}, what_for)[0];
  };
  const StatVector with = simulated(rung.model);
  SensorModel found = rung.model;
  bool moved = false;
  for (const EffectInstance& effect : rung.model.effects) {
    const EffectInstance* begun = given.find(effect.id);
    const auto parameters = parameters_of(rung, effect.id);
    if (!begun || parameters.size() < 2) continue;  // one alone was tried near and far
    SensorModel as_given = rung.model;
    for (const FitParameter& p : parameters) value_in(as_given, p.id, p.name).value = begun->value(p.name);
    // One that went where it clears nothing has to find back.
    auto captures = either(captures_that_differ(layout, with, simulated(without_effect(rung.model, effect.id))),
                           captures_that_differ(layout, with, simulated(as_given)));
    if (2 * static_cast<int>(captures.size()) > layout.captures) continue;
    if (std::ranges::find_first_of(captures, out) == captures.end()) continue;
    std::erase_if(captures, [&](int c) { return !layout.train[c]; });
    if (captures.empty()) continue;
    const auto score = cv::makePtr<MaskScore>(experiment, measured, rung, parameters, captures, options.seed + 7001);
    const auto model = with_mask(rung, *begun, parameters, score);
    if (!model) continue;
    moved = true;
    for (const FitParameter& p : parameters) value_in(found, p.id, p.name).value = model->find(p.id)->value(p.name);
  }
  if (!moved) return false;
  Rung next = made_anew(experiment, motions, measured, found, rung.offsets, options, rung.fit.parameters);
  const double now = proper_score(layout, rung, Part::train), then = proper_score(layout, next, Part::train);
  if (tracing()) fmt::print(stderr, "  masks: proper on train {:.4f} -> {:.4f}\n", now, then);
  if (then >= now) return false;
  rung = std::move(next);
  return true;
}

std::optional<std::string> mask_that_may_stand_elsewhere(const Experiment& experiment,
                                                         const std::vector<SceneMotion>& motions,
                                                         const Measurement& measured, const SensorModel& given,
                                                         const RungOptions& options, const Rung& rung) {
  for (const EffectInstance& effect : rung.model.effects) {
    const EffectInstance* begun = given.find(effect.id);
    if (!begun || !effect.declaration(experiment.forward().catalogue()).reason) continue;
    const auto parameters = parameters_of(rung, effect.id);
    Eigen::VectorXd here(parameters.size()), there(parameters.size());
    for (int p = 0; p < here.size(); ++p) {
      here[p] = parameters[p].scaled(effect.value(parameters[p].name));
      there[p] = parameters[p].scaled(begun->value(parameters[p].name));
    }
    if (here == there) continue;
    for (const double back : {0.5, 1.0}) {  // of the way to where the user put it
      const Eigen::VectorXd x = here + back * (there - here);
      const Rung next = made_anew(experiment, motions, measured, with_values(rung.model, parameters, x), rung.offsets,
                                  options, rung.fit.parameters);
      const auto fits = goodness_of_fit(experiment.layout(), next);
      for (const SegmentFit& fit : fits)
        if (tracing() && (fit.significant() || fit.segment == "drop-out"))
          fmt::print(stderr, "  {} back by {}: {} on {} {:.2f}, excess {:.3f} +- {:.3f}\n", effect.id, back,
                     fit.segment, fit.train ? "train" : "test", fit.ratio, fit.excess, fit.spread);
      if (std::ranges::none_of(fits, &SegmentFit::significant)) return effect.id;
    }
  }
  return std::nullopt;
}

}  // namespace binrig
