#include "diagnose/fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "core/parallel.h"
#include "diagnose/hypotheses.h"
#include "diagnose/mean_of_simulations.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double least_signal = 0.5;  // a segment of a derivative that is more than half noise is left out

EffectInstance* find_instance(SensorModel& model, const std::string& id) {
  for (auto& effect : model.effects)
    if (effect.id == id) return &effect;
  return nullptr;
}

SensorModel with_values(SensorModel model, const std::vector<FitParameter>& parameters, const Eigen::VectorXd& x) {
  for (std::size_t p = 0; p < parameters.size(); ++p)
    if (auto* instance = find_instance(model, parameters[p].id))
      instance->values[parameters[p].name].value = parameters[p].natural(x[static_cast<int>(p)]);
  return model;
}

bool draws_map(const SensorModel& model, const EffectCatalogue& catalogue, const std::string& id) {
  const EffectInstance* instance = model.find(id);
  return instance && instance->declaration(catalogue).per_unit_map;
}

std::vector<Whitened> differences_of(const Standard& standard, const std::vector<StatVector>& changes) {
  std::vector<Whitened> result;
  for (const StatVector& one : changes) result.push_back(standard.difference(one));
  return result;
}

constexpr double least_gain = 1;   // of chi, for which a value is taken
constexpr double pause_below = 4;  // data's information on a parameter, in units of its prior's, see Fit::paused

/// Minimum of x'Mx/2 - b'x over |x| <= limit, element by element, by projected coordinate descent: a parameter that
/// would go far stops at its limit without holding back the others.
Eigen::VectorXd minimum_in_box(const Eigen::MatrixXd& m, const Eigen::VectorXd& b, const Eigen::VectorXd& lower,
                               const Eigen::VectorXd& upper) {
  const int n = static_cast<int>(b.size());
  Eigen::VectorXd x = m.ldlt().solve(b);
  if ((x.array() >= lower.array()).all() && (x.array() <= upper.array()).all()) return x;
  x = x.cwiseMax(lower).cwiseMin(upper);
  for (int sweep = 0; sweep < 500; ++sweep) {
    double moved = 0;
    for (int p = 0; p < n; ++p) {
      const double next = std::clamp(x[p] + (b[p] - m.row(p).dot(x)) / m(p, p), lower[p], upper[p]);
      moved = std::max(moved, std::abs(next - x[p]) / std::max(upper[p] - lower[p], 1e-12));
      x[p] = next;
    }
    if (moved < 1e-6) break;
  }
  return x;
}

class Fitter {
 public:
  Fitter(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
         const std::vector<FitParameter>& parameters, const std::vector<Offset>& offsets, const FitOptions& options)
      : experiment_(experiment),
        standard_(standard),
        metric_(metric),
        data_(data),
        parameters_(parameters),
        offsets_(offsets),
        options_(options),
        n_(static_cast<int>(parameters.size())) {}

  Fit run(const SensorModel& start) {
    fit_.value.resize(n_);
    SensorModel first = start;
    for (int p = 0; p < n_; ++p)
      fit_.value[p] = parameters_[p].scaled(find_instance(first, parameters_[p].id)->value(parameters_[p].name));
    now_.offsets = offsets_;
    now_.place = options_.place;
    now_ = evaluate(with_values(start, parameters_, fit_.value), fit_.value);
    descend();
    if (scan()) descend();
    if (probe()) descend();
    fit_.parameters = parameters_;
    fit_.model = now_.model;
    fit_.offsets = now_.offsets;
    fit_.place = now_.place;
    fit_.residual = now_.residual;
    fit_.chi = now_.chi;
    return std::move(fit_);
  }

 private:
  struct State {
    SensorModel model;
    std::vector<Offset> offsets;
    std::vector<double> place;
    std::vector<StatVector> simulations;
    std::vector<Whitened> noise;  // of their mean, see MeanOfSimulations
    Whitened residual;
    double chi = 0, dispersion = 1;
  };

  Trial trial(const SensorModel& model, const std::vector<Offset>& offsets, int k) const {
    return {model,
            offsets,
            options_.seed + static_cast<std::uint64_t>(k),
            options_.part,
            options_.most_frames,
            options_.shorten_series};
  }

  State evaluate(const SensorModel& model, const Eigen::VectorXd& x) const {
    State state;
    state.model = model;
    state.offsets = now_.offsets;
    state.place = now_.place;
    Explained explained = explain(state);
    for (int round = 0; round < 3 && moved(explained, state); ++round) explained = explain(state);
    state.residual = std::move(explained.rest);
    const auto known = std::count_if(state.residual.begin(), state.residual.end(), [](float v) { return v != 0; });
    state.dispersion = std::max(1.0, explained.chi / std::max<double>(1, static_cast<double>(known)));
    state.chi = explained.chi;
    for (int p = 0; p < n_; ++p)
      if (!parameters_[p].circular)
        state.chi += std::pow((x[p] - parameters_[p].prior_centre) / parameters_[p].prior_sigma, 2);
    return state;
  }

  /// Simulates where the state says that targets stand.
  Explained explain(State& state) const {
    std::vector<Trial> trials;
    for (int k = 0; k < options_.seeds; ++k) trials.push_back(trial(state.model, state.offsets, k));
    MeanOfSimulations mean =
        mean_of(standard_, simulate_typical_units(experiment_, trials, "fitting parameters", &state.simulations));
    Whitened difference = data_;
    for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= mean.mean[i];
    state.noise = std::move(mean.noise);
    return metric_.explain(difference, state.place, {}, state.noise);
  }

  /// Moves the targets of a state to where they want to be; false if they stand there.
  bool moved(const Explained& explained, State& state) const {
    constexpr double near_enough = 1;  // prior sigmas
    if (!options_.motions || state.place.size() < options_.motions->size()) return false;
    const std::size_t count = options_.motions->size();
    std::vector<double> values(state.place.begin(), state.place.begin() + static_cast<long>(count));
    double furthest = 0;
    for (std::size_t m = 0; m < count; ++m) {
      if (explained.values[m] == 0) continue;  // of a capture that does not count
      furthest = std::max(furthest, std::abs(explained.values[m] - values[m]));
      values[m] = explained.values[m];
    }
    if (furthest < near_enough) return false;
    auto offsets = offsets_of(experiment_.layout(), *options_.motions, values, {});
    const auto reached = values_of(*options_.motions, offsets);
    double step = 0;
    for (std::size_t m = 0; m < count; ++m) step = std::max(step, std::abs(reached[m] - state.place[m]));
    if (step < near_enough) return false;  // what is no small motion was clipped
    state.offsets = std::move(offsets);
    std::copy(reached.begin(), reached.end(), state.place.begin());
    return true;
  }

  /// Where a derivative is taken to: inwards of the bounds.
  double derivative_step(int p) const {
    const FitParameter& parameter = parameters_[p];
    const double ahead = parameter.natural(fit_.value[p] + parameter.step);
    const bool outside =
        !parameter.circular && std::abs(parameter.scaled(ahead) - fit_.value[p]) < 0.5 * parameter.step;
    return outside ? -parameter.step : parameter.step;
  }

  /// Captures in which a parameter changed anything when it was asked at `value`.
  struct Touched {
    double value = 0;
    std::vector<int> captures;
  };

  std::vector<int> changed_captures(const StatVector& a, const StatVector& b) const {
    std::vector<int> captures;
    for (const Block& block : experiment_.layout().blocks) {
      if (!captures.empty() && captures.back() == block.capture) continue;
      for (int i = block.offset; i < block.offset + block.size; ++i)
        if (a[i] != b[i] && !(std::isnan(a[i]) && std::isnan(b[i]))) {
          captures.push_back(block.capture);
          break;
        }
    }
    return captures;
  }

  /// Simulations of all seeds with one parameter a step ahead, by parameter. Many parameters move nothing in most
  /// captures (a threshold for highlights on planes): where the first seed shows no change, no other is simulated, and
  /// none later while the parameter stays near.
  std::vector<std::vector<StatVector>> simulate_ahead(const std::vector<int>& moved) {
    touched_.resize(n_);
    std::vector<std::vector<StatVector>> ahead(n_);
    const auto simulate = [&](bool asked_before, int seeds) {
      std::vector<Trial> trials;
      std::vector<std::pair<int, int>> of;  // parameter, seed
      for (const int p : moved) {
        if (touched_[p].has_value() != asked_before || (asked_before && touched_[p]->captures.empty())) continue;
        Eigen::VectorXd x = fit_.value;
        x[p] += derivative_step(p);
        for (int k = static_cast<int>(ahead[p].size()); k < seeds; ++k) {
          trials.push_back(trial(with_values(now_.model, parameters_, x), now_.offsets, k));
          if (asked_before) trials.back().only = touched_[p]->captures;
          of.emplace_back(p, k);
        }
      }
      auto results = experiment_.simulate(trials, "fitting parameters");
      for (std::size_t t = 0; t < trials.size(); ++t) {
        const auto [p, k] = of[t];
        if (asked_before) stay_elsewhere(results[t], now_.simulations[k], trials[t].only);
        ahead[p].push_back(std::move(results[t]));
      }
    };
    for (const int p : moved)
      if (touched_[p] && std::abs(touched_[p]->value - fit_.value[p]) > parameters_[p].longest) touched_[p].reset();
    simulate(false, 1);
    for (const int p : moved)
      if (!touched_[p]) touched_[p] = Touched{fit_.value[p], changed_captures(ahead[p][0], now_.simulations[0])};
    simulate(true, options_.seeds);
    for (const int p : moved)
      for (int k = static_cast<int>(ahead[p].size()); k < options_.seeds; ++k) ahead[p].push_back(now_.simulations[k]);
    return ahead;
  }

  /// In captures that were not simulated.
  void stay_elsewhere(StatVector& result, const StatVector& as_it_is, const std::vector<int>& simulated) const {
    for (const Block& block : experiment_.layout().blocks)
      if (std::find(simulated.begin(), simulated.end(), block.capture) == simulated.end())
        std::copy_n(as_it_is.begin() + block.offset, block.size, result.begin() + block.offset);
  }

  void simulate_slopes() {
    fit_.slopes.resize(n_, Whitened(experiment_.layout().size, 0.f));
    fit_.seed_slopes.resize(n_);
    std::vector<int> moved;
    for (int p = 0; p < n_; ++p)
      if (!fit_.paused[p]) moved.push_back(p);
    auto simulated = simulate_ahead(moved);
    parallel_for(static_cast<int>(moved.size()), [&](int m) {
      const float step = static_cast<float>(derivative_step(moved[m]));
      std::vector<StatVector>& changes = simulated[moved[m]];
      for (int k = 0; k < options_.seeds; ++k)
        for (std::size_t i = 0; i < changes[k].size(); ++i)
          changes[k][i] = (changes[k][i] - now_.simulations[k][i]) / step;
      // Where nothing is known nothing changes: beside neighbours that all move along, that would be a trace.
      fill_unknown(experiment_.layout(), changes, true);
      std::vector<Whitened> differences = differences_of(standard_, changes);
      if (draws_map(now_.model, experiment_.forward().catalogue(), parameters_[moved[m]].id))
        for (Whitened& d : differences) forget_bias(d);  // of the typical unit it stays where it is
      const Whitened& mean = fit_.slopes[moved[m]] =
          shrunk(experiment_.layout(), mean_over_seeds(experiment_.layout(), differences), least_signal);
      for (Whitened& d : differences)
        for (std::size_t i = 0; i < d.size(); ++i)
          if (mean[i] == 0) d[i] = 0;
      fit_.seed_slopes[moved[m]] = std::move(differences);
    });
  }

  void forget_bias(Whitened& change) const {
    for (const Block& block : experiment_.layout().blocks)
      if (segments()[block.segment].name == "bias") std::fill_n(change.begin() + block.offset, block.size, 0.f);
  }

  /// Normal equations of the next step. A simulation that scatters more has derivatives that scatter along, so that
  /// those of each seed are only held against what the other seeds leave of the data.
  void linearise(Eigen::MatrixXd& a, Eigen::VectorXd& b) {
    const int seeds = options_.seeds;
    const Pull pull(now_.residual);
    std::vector<Whitened> left(seeds, pull.direct());
    if (seeds > 1)
      parallel_for(seeds, [&](int k) {
        const Whitened own = metric_.apply(now_.noise[k]);
        const float others = std::sqrt(seeds / (seeds - 1.f));
        for (std::size_t i = 0; i < own.size(); ++i) left[k][i] += others * own[i];
      });
    SeedSlopes freed(n_), curved(n_);
    b = Eigen::VectorXd::Zero(n_);
    parallel_for(n_, [&](int p) {
      const auto& slopes = fit_.seed_slopes[p];
      for (std::size_t k = 0; k < slopes.size(); ++k) {
        freed[p].push_back(metric_.apply(slopes[k]));
        curved[p].push_back(pull.curved(slopes[k], freed[p][k]));
        b[p] += pull.along(left[k], slopes[k], freed[p][k]) / seeds;
      }
    });
    const Eigen::MatrixXd together = products_of_means(curved, freed);
    Eigen::VectorXd scale(n_);
    for (int p = 0; p < n_; ++p) scale[p] = parameters_[p].prior_sigma;
    a = seeds > 1 ? positive_products(unbiased_products(curved, freed), together, scale) : together;
    for (int p = 0; p < n_; ++p) {
      const double precision = parameters_[p].circular ? 0.01 : 1 / std::pow(parameters_[p].prior_sigma, 2);
      if (a(p, p) < pause_below * precision) fit_.paused[p] = true;
      if (parameters_[p].narrow && a(p, p) > 0)  // ten standard deviations
        parameters_[p].step = std::clamp(10 / std::sqrt(a(p, p)), parameters_[p].step / 5, parameters_[p].step * 2);
      a(p, p) += precision;
      if (!parameters_[p].circular) b[p] -= precision * (fit_.value[p] - parameters_[p].prior_centre);
    }
    fit_.precision = a;
  }

  /// How far parameters may go in one step.
  void box(Eigen::VectorXd& lower, Eigen::VectorXd& upper) const {
    lower.resize(n_);
    upper.resize(n_);
    for (int p = 0; p < n_; ++p) {
      const FitParameter& parameter = parameters_[p];
      lower[p] = -parameter.longest;
      upper[p] = parameter.longest;
      if (parameter.circular) continue;
      lower[p] = std::max(lower[p], std::min(0.0, parameter.scaled(parameter.lower) - fit_.value[p]));
      upper[p] = std::min(upper[p], std::max(0.0, parameter.scaled(parameter.upper) - fit_.value[p]));
      // A magnitude that falls to zero at once stays there: its derivative is zero, too.
      if (!parameter.logarithmic && parameter.lower >= 0 && fit_.value[p] > 0)
        lower[p] = std::max(lower[p], -0.5 * fit_.value[p]);
    }
  }

  Eigen::VectorXd within_bounds(Eigen::VectorXd x) const {
    for (int p = 0; p < n_; ++p)
      if (!parameters_[p].circular) x[p] = parameters_[p].scaled(parameters_[p].natural(x[p]));
    return x;
  }

  void descend() {
    fit_.paused = options_.paused;
    fit_.paused.resize(n_, false);
    if (n_ == 0) {
      fit_.converged = true;
      return;
    }
    double damping = 1e-3;
    const bool given = options_.nearby && static_cast<int>(options_.nearby->slopes.size()) == n_;
    bool stale = !given;
    if (given) fit_.slopes = options_.nearby->slopes, fit_.seed_slopes = options_.nearby->seed_slopes;
    for (int simulated_slopes = 0;; ++fit_.rounds) {
      if (stale && simulated_slopes >= std::max(options_.iterations, given ? 0 : 1)) return;
      if (stale) simulate_slopes(), ++simulated_slopes;
      const bool fresh = stale;
      Eigen::MatrixXd a;
      Eigen::VectorXd b, lower, upper;
      linearise(a, b);
      if (options_.iterations == 0 && !given) return;
      box(lower, upper);
      const double enough = options_.converged * now_.dispersion;
      double gained = 0, promised = 0;
      const Eigen::VectorXd from = fit_.value;
      const int attempts = fresh ? 5 : options_.iterations == 0 ? 3 : 1;
      for (int attempt = 0; attempt < attempts && gained == 0; ++attempt) {
        Eigen::MatrixXd damped = a;
        damped.diagonal() *= 1 + damping;
        const Eigen::VectorXd delta = minimum_in_box(damped, b, lower, upper);
        promised = delta.dot(2 * b - a * delta);
        if (promised < 0.5 * enough) break;
        const Eigen::VectorXd x = fit_.value + delta;
        State next = evaluate(with_values(now_.model, parameters_, x), x);
        if (next.chi < now_.chi) {
          gained = now_.chi - next.chi;
          fit_.value = x;
          now_ = std::move(next);
          damping = std::max(1e-4, damping / 5);
        } else {
          damping = std::max(0.01, 10 * damping);
        }
      }
      // What moves pixel after pixel falls by far more than slopes, which see few of them, promise.
      while (gained > 2 * promised) {
        const Eigen::VectorXd x = within_bounds(fit_.value + (fit_.value - from));
        if (x == fit_.value) break;
        State next = evaluate(with_values(now_.model, parameters_, x), x);
        if (next.chi > now_.chi - least_gain) break;
        gained += now_.chi - next.chi;
        fit_.value = x;
        now_ = std::move(next);
      }
      if (tracing())
        fmt::print(stderr, "  round {} {} chi {:.0f} dispersion {:.2f} promised {:.1f} gained {:.1f} captures {}\n",
                   fit_.rounds, fresh ? "fresh" : "kept", now_.chi, now_.dispersion, promised, gained,
                   experiment_.simulated());
      if (gained < enough && fresh) {
        fit_.converged = true;
        return;
      }
      // Slopes of far away lead into the wrong one of two valleys: they are only kept near the end.
      stale = gained < enough || gained < 0.5 * promised || gained > 0.01 * now_.chi;
    }
  }

  /// Near and far, to either side, as long as it helps; true if anything did.
  bool probe() {
    const EffectCatalogue& catalogue = experiment_.forward().catalogue();
    bool moved = false;
    for (int p = 0; p < n_ && options_.probe; ++p) {
      const FitParameter& parameter = parameters_[p];
      const bool smooth = p >= static_cast<int>(touched_.size()) || !touched_[p] ||
                          2 * static_cast<int>(touched_[p]->captures.size()) > experiment_.layout().captures;
      if (smooth || parameter.name != now_.model.find(parameter.id)->declaration(catalogue).amplitude) continue;
      for (const double reach : {0.5, 0.12, 0.03})
        for (const double direction : {1.0, -1.0})
          for (;;) {
            Eigen::VectorXd x = fit_.value;
            x[p] += direction * reach * parameter.longest;
            x = within_bounds(x);
            if (x == fit_.value) break;
            State next = evaluate(with_values(now_.model, parameters_, x), x);
            if (next.chi > now_.chi - 4 * now_.dispersion) break;  // two standard deviations
            if (tracing())
              fmt::print(stderr, "  {}.{} = {:.4g}: chi {:.0f} (was {:.0f})\n", parameter.id, parameter.name,
                         parameter.natural(x[p]), next.chi, now_.chi);
            fit_.value = x;
            now_ = std::move(next);
            moved = true;
          }
    }
    return moved;
  }

  /// Tries a value of a parameter; keeps it if chi falls. Returns by how much it does.
  double try_value(const std::string& id, const ParameterSpec& spec, double value) {
    value = std::clamp(value, spec.lower, spec.upper);
    if (value == now_.model.find(id)->value(spec.name)) return -std::numeric_limits<double>::infinity();
    SensorModel changed = now_.model;
    find_instance(changed, id)->values[spec.name].value = value;
    State next = evaluate(changed, fit_.value);
    if (tracing())
      fmt::print(stderr, "  {}.{} = {:.5g}: chi {:.0f} (best {:.0f})\n", id, spec.name, value, next.chi, now_.chi);
    const double gain = now_.chi - next.chi;
    if (gain > least_gain) now_ = std::move(next);
    return gain;
  }

  /// Periods and steps have narrow valleys: the whole typical range, then closer and closer about the best. Returns
  /// how close that came, relative to the value.
  double scan_range(const std::string& id, const ParameterSpec& spec) {
    constexpr int places = 21;  // over 5 octaves: every power of two
    constexpr double closest = 1.003;
    const double ratio = std::pow(spec.typical_high / spec.typical_low, 1.0 / (places - 1));
    for (int k = 0; k < places; ++k) try_value(id, spec, spec.typical_low * std::pow(ratio, k));
    double r = std::sqrt(ratio);
    while (r > closest) {
      const double value = now_.model.find(id)->value(spec.name);
      const double up = try_value(id, spec, value * r);
      if (up > least_gain) continue;
      const double down = try_value(id, spec, value / r);
      if (down > least_gain) continue;
      if (std::min(up, down) > -4 * now_.dispersion) break;  // two standard deviations
      r = std::sqrt(r);
    }
    return std::log(r);
  }

  /// Step by step to either side, as long as it helps.
  void walk(const std::string& id, const ParameterSpec& spec, double share, int most) {
    for (const double direction : {1.0, -1.0})
      for (int moves = 0; moves < most; ++moves) {
        const double value = now_.model.find(id)->value(spec.name);
        const double step = spec.kind == ParameterKind::integer ? std::max(1.0, std::round(share * value))
                            : spec.either_sign                  ? share * spec.typical_high
                                                                : share * value;
        if (try_value(id, spec, value + direction * step) <= least_gain) break;
      }
  }

  /// Whole numbers value by value; periods, steps and places until they are so near that they can be fitted with all
  /// others. True if there are such.
  bool scan() {
    const EffectCatalogue& catalogue = experiment_.forward().catalogue();
    bool near = false;
    for (const auto& id : options_.scan_ids) {
      if (!now_.model.find(id)) continue;
      const auto& specs = now_.model.find(id)->declaration(catalogue).parameters;
      const bool has_phase = std::any_of(specs.begin(), specs.end(),
                                         [](const ParameterSpec& spec) { return spec.kind == ParameterKind::phase; });
      for (const auto& spec : specs) {
        if (spec.kind == ParameterKind::integer) {
          if (!fixed(id, spec.name)) walk(id, spec, 0.25, 2);
          continue;
        }
        if (spec.interpolate || fixed(id, spec.name) || is_fitted(id, spec.name)) continue;
        double closeness = 0.003;
        if (spec.either_sign) {
          walk(id, spec, 0.06, 5);
          walk(id, spec, 0.03, 1);
          closeness = 0.015 * spec.typical_high;
        } else if (!has_phase && spec.log_scaled && spec.typical_low > 0 &&
                   (options_.scan_all_ranges || id == options_.scan_ranges_of)) {
          closeness = scan_range(id, spec);
        } else if (has_phase) {
          const double value = now_.model.find(id)->value(spec.name);
          closeness = 0.1 * period_spacing(spec, value, experiment_.nominal(0).depth_mm.cols);
        } else {
          walk(id, spec, 0.2, 2);
          walk(id, spec, 0.05, 2);
        }
        // How a step's comb meets the data changes within thousandths: no slope leads there. A place has a side and is
        // no step: its trace moves smoothly.
        if (!spec.either_sign && spec.name == now_.model.find(id)->declaration(catalogue).amplitude) continue;
        parameters_.push_back(fit_parameter(*now_.model.find(id), spec, closeness));
        near = true;
      }
    }
    if (!near) return false;
    n_ = static_cast<int>(parameters_.size());
    fit_.value.resize(n_);
    for (int p = 0; p < n_; ++p)
      fit_.value[p] = parameters_[p].scaled(now_.model.find(parameters_[p].id)->value(parameters_[p].name));
    now_ = evaluate(now_.model, fit_.value);  // with their priors
    return true;
  }

  bool fixed(const std::string& id, const std::string& name) const {
    return std::find(options_.fixed.begin(), options_.fixed.end(), id + "." + name) != options_.fixed.end();
  }

  bool is_fitted(const std::string& id, const std::string& name) const {
    return std::any_of(parameters_.begin(), parameters_.end(),
                       [&](const FitParameter& p) { return p.id == id && p.name == name; });
  }

  const Experiment& experiment_;
  const Standard& standard_;
  const Metric& metric_;
  const Whitened& data_;
  std::vector<FitParameter> parameters_;
  const std::vector<Offset>& offsets_;
  const FitOptions& options_;
  int n_;
  Fit fit_;
  State now_;
  std::vector<std::optional<Touched>> touched_;  // by parameter
};

}  // namespace

Fit fit_model(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
              const SensorModel& start, const std::vector<FitParameter>& parameters, const std::vector<Offset>& offsets,
              const FitOptions& options) {
  return Fitter(experiment, standard, metric, data, parameters, offsets, options).run(start);
}

}  // namespace binrig
