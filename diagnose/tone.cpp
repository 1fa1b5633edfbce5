#include "diagnose/tone.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <Eigen/Core>

#include "diagnose/mean_of_simulations.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double first_step = 0.24, last_step = 0.1;  // of logarithms
constexpr int most_rounds = 8;
constexpr double map_share = 0.95;                // what is left of pixels' tosses would count against it cell by cell
constexpr double trusted = 0.05;                  // of the gain: what signatures promise is right to that
constexpr double apart = 0.12, wide_apart = 0.7;  // of a grid: of what each value is a trace of its own, of all else

class ToneFit {
 public:
  ToneFit(const Refiner& refiner, const Hypothesis& hypothesis)
      : refiner_(refiner), rung_(refiner.rung), hypothesis_(hypothesis) {
    for (const ParameterSpec& spec : hypothesis.declaration->parameters)
      if (spec.log_scaled || (spec.name == hypothesis.declaration->amplitude && !spec.either_sign))
        specs_.push_back(&spec);
    deviation_ = Eigen::VectorXd::Ones(static_cast<int>(specs_.size()));  // an e-fold, where nothing says more
  }

  RefinedFit run(const LinearGain& start) {
    values_ = start.values;
    climb();
    weigh();
    const EffectCatalogue& catalogue = refiner_.experiment.forward().catalogue();
    RefinedFit result;
    result.fit.model = rung_.model;
    EffectInstance& instance = add_effect(result.fit.model, catalogue, hypothesis_.effect, values_);
    result.id = instance.id;
    for (std::size_t p = 0; p < specs_.size(); ++p) {
      ParameterValue& value = instance.values[specs_[p]->name];
      const double half = std::exp(1.96 * deviation_[static_cast<int>(p)]);
      value.ci95 = {{clipped(*specs_[p], value.value / half), clipped(*specs_[p], value.value * half)}};
    }
    return result;
  }

 private:
  static double clipped(const ParameterSpec& spec, double value) { return std::clamp(value, spec.lower, spec.upper); }

  std::map<std::string, double> moved(std::size_t p, double by, std::map<std::string, double> values) const {
    double& value = values[specs_[p]->name];
    value = clipped(*specs_[p], value * std::exp(by));
    return values;
  }

  /// One hypothesis for each set of values.
  Hypotheses at(const std::vector<std::map<std::string, double>>& all) const {
    Hypotheses result;
    for (const auto& values : all) {
      StrengthPath path;
      path.atoms.push_back({values});
      result.tested.push_back({hypothesis_.effect, hypothesis_.declaration, {path}});
    }
    return result;
  }
  std::vector<LinearGain> gains(const std::vector<std::map<std::string, double>>& all, int seeds) const {
    SignatureOptions few;
    few.seed = refiner_.seed + 60;
    few.shared = false;
    few.seeds = seeds;
    few.map_share = map_share;
    return gains_about(refiner_.experiment, rung_, at(all), few);
  }

  /// To where the signatures gain most; the strength goes along.
  void climb() {
    double step = first_step;
    for (int round = 0; round < most_rounds && step > last_step; ++round) {
      std::vector<std::map<std::string, double>> asked{values_};
      for (std::size_t p = 0; p < specs_.size(); ++p)
        if (specs_[p]->name != hypothesis_.declaration->amplitude)
          for (const double by : {-step, step}) asked.push_back(moved(p, by, values_));
      const std::vector<LinearGain> found = gains(asked, 2);
      const auto best = std::ranges::max_element(found, {}, &LinearGain::gain);
      if (best->gain <= 0) return;
      if (best == found.begin()) step /= 2;
      values_ = best->values;
      trace("climbing", best->gain);
    }
  }

  /// Mean and spread of what a grid around there makes likely: within a ring of the measured spectrum the gain is flat,
  /// and its highest point nowhere in particular.
  void weigh() {
    std::vector<std::map<std::string, double>> asked{values_};
    for (std::size_t p = 0; p < specs_.size(); ++p) {
      const bool itself = !specs_[p]->interpolate;
      if (specs_[p]->name == hypothesis_.declaration->amplitude) continue;
      const auto before = std::exchange(asked, {});
      for (const auto& values : before)
        for (int k = itself ? -3 : -1; k <= (itself ? 3 : 1); ++k)
          asked.push_back(moved(p, k * (itself ? apart : wide_apart), values));
    }
    const std::vector<LinearGain> found = gains(asked, 4);
    const double most = std::ranges::max_element(found, {}, &LinearGain::gain)->gain;
    if (most <= 0) return;
    // The simulations scatter, too, by half as much again; and what signatures promise is right to some percents.
    const double scale = std::max(1.5 * rung_.dispersion, trusted * most);
    const int n = static_cast<int>(specs_.size());
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(n), square = sum;
    double total = 0;
    for (const LinearGain& gain : found) {
      if (gain.gain <= 0) continue;  // no strength of it explains anything
      const double weight = std::exp((gain.gain - most) / (2 * scale));
      Eigen::VectorXd x(n);
      for (int p = 0; p < n; ++p) x[p] = std::log(gain.values.at(specs_[p]->name));
      total += weight, sum += weight * x, square += weight * x.cwiseAbs2();
      if (tracing()) {
        fmt::print(stderr, "  {} gains {:.1f}:", hypothesis_.effect, gain.gain);
        for (int p = 0; p < n; ++p) fmt::print(stderr, " {} {:.4g}", specs_[p]->name, std::exp(x[p]));
        fmt::print(stderr, "\n");
      }
    }
    const Eigen::VectorXd mean = sum / total;
    deviation_ = (square / total - mean.cwiseAbs2()).cwiseMax(0);
    for (int p = 0; p < n; ++p) {
      const bool amplitude = specs_[p]->name == hypothesis_.declaration->amplitude;
      // Power, and with it the trace, is the amplitude's square; between the points of the grid all is alike.
      const double own =
          amplitude ? scale / (4 * std::max(1.0, most)) : std::pow(specs_[p]->interpolate ? wide_apart : apart, 2) / 12;
      deviation_[p] = std::sqrt(deviation_[p] + own);
      values_[specs_[p]->name] = clipped(*specs_[p], std::exp(mean[p]));
    }
    trace("weighed", most);
  }

  void trace(const char* what, double gain) const {
    if (!tracing()) return;
    fmt::print(stderr, "  {} {}, gain {:.1f}:", hypothesis_.effect, what, gain);
    for (const auto& [name, value] : values_) fmt::print(stderr, " {} {:.4g}", name, value);
    fmt::print(stderr, "\n");
  }

  const Refiner& refiner_;
  const Rung& rung_;
  const Hypothesis& hypothesis_;
  std::vector<const ParameterSpec*> specs_;  // that are fitted, by their logarithms
  std::map<std::string, double> values_;
  Eigen::VectorXd deviation_;  // of the logarithms
};

}  // namespace

ClearRemainders clear_remainders(const Refiner& refiner, const SensorModel& model) {
  constexpr int seeds = 4;  // must agree
  const Rung& rung = refiner.rung;
  const Layout& layout = refiner.experiment.layout();
  const auto simulated = [&](const SensorModel& of) {
    std::vector<Trial> trials;
    for (std::uint64_t k = 0; k < seeds; ++k) trials.push_back({of, rung.offsets, refiner.seed + k, Part::all, 0});
    return simulate_typical_units(refiner.experiment, trials, "refining hypotheses");
  };
  const auto remainder = [&](Whitened change) {
    Whitened difference = rung.data;
    for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= change[i];
    Explained train = rung.train.explain(difference, rung.place);
    const Explained test = rung.test.explain(difference, rung.place, train.global);
    return Remainder{std::move(change), train.chi, test.chi + test.shared_prior, 0, std::move(train.values)};
  };
  const StatVector change =
      shrunk_change(layout, rung.standard.spread(), simulated(model), simulated(rung.model), map_share);
  return {remainder(Whitened(layout.size, 0.f)), remainder(rung.standard.difference(change))};
}

RefinedFit refine_tone(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start) {
  return ToneFit(refiner, hypothesis).run(start);
}

}  // namespace binrig
