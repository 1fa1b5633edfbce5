#include "diagnose/fit.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "core/parallel.h"

namespace binrig {
namespace {

constexpr double pi = 3.14159265358979323846;
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

/// Mean of differences between paired simulations, each segment shrunk by the share of it that is signal.
Whitened shrunk_mean(const Layout& layout, const std::vector<Whitened>& differences) {
  const int k = static_cast<int>(differences.size());
  Whitened mean(layout.size, 0.f);
  for (const auto& d : differences)
    for (int i = 0; i < layout.size; ++i) mean[i] += d[i] / k;
  if (k < 2) return mean;
  std::vector<double> signal(segments().size(), 0), noise(segments().size(), 0);
  for (const auto& block : layout.blocks)
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      signal[block.segment] += static_cast<double>(mean[i]) * mean[i];
      for (const auto& d : differences)
        noise[block.segment] += static_cast<double>(d[i] - mean[i]) * (d[i] - mean[i]) / (k * (k - 1.0));
    }
  for (const auto& block : layout.blocks) {
    const double share = signal[block.segment] > 0 ? 1 - noise[block.segment] / signal[block.segment] : 0;
    const float f = share < least_signal ? 0.f : static_cast<float>(share);
    for (int i = block.offset; i < block.offset + block.size; ++i) mean[i] *= f;
  }
  return mean;
}

std::vector<Whitened> whiten_all(const Standard& standard, const std::vector<StatVector>& simulations) {
  std::vector<Whitened> result(simulations.size());
  parallel_for(static_cast<int>(simulations.size()), [&](int k) { result[k] = standard.linear(simulations[k]); });
  return result;
}

}  // namespace

double FitParameter::scaled(double value) const { return logarithmic ? std::log(std::max(value, 1e-12)) : value; }

double FitParameter::natural(double scaled_value) const {
  if (circular) {
    double wrapped = std::fmod(scaled_value - lower, 2 * pi);
    if (wrapped < 0) wrapped += 2 * pi;
    return std::clamp(lower + wrapped, lower, upper);
  }
  return std::clamp(logarithmic ? std::exp(scaled_value) : scaled_value, lower, upper);
}

std::vector<FitParameter> fit_parameters(const SensorModel& model, const EffectCatalogue& catalogue,
                                         const std::vector<std::string>& ids) {
  std::vector<FitParameter> result;
  for (const auto& instance : model.effects) {
    if (!ids.empty() && std::find(ids.begin(), ids.end(), instance.id) == ids.end()) continue;
    for (const auto& spec : instance.declaration(catalogue).parameters) {
      if (spec.kind == ParameterKind::integer || !spec.interpolate) continue;
      if (spec.lower == spec.upper) continue;
      FitParameter p;
      p.id = instance.id;
      p.name = spec.name;
      p.unit = spec.unit;
      p.lower = spec.lower;
      p.upper = spec.upper;
      p.circular = spec.kind == ParameterKind::phase;
      const double low = spec.typical_low, high = spec.typical_high, width = std::abs(high - low);
      const double value = instance.value(spec.name);
      p.logarithmic = spec.log_scaled && spec.lower >= 0 && value > 0 && !spec.either_sign;
      if (p.logarithmic) {
        if (p.lower <= 0) p.lower = std::max(1e-9, std::min(low, value) * 1e-3);
        p.prior_sigma = std::max(1.0, 0.5 * std::log(std::max(high, 1e-9) / std::max(low, 1e-9)));
        p.step = 0.1;
        p.longest = 0.5;
      } else if (p.circular) {
        p.prior_sigma = 4;
        p.step = 0.15;
        p.longest = 0.8;
      } else {
        const double scale = spec.either_sign ? std::abs(high) : std::max(width, 1e-9);
        p.prior_sigma = scale;
        p.step = 0.05 * scale;
        p.longest = 0.25 * scale;
      }
      p.prior_centre = p.scaled(value);
      result.push_back(p);
    }
  }
  return result;
}

MeanOfSimulations mean_of(const Standard& standard, const std::vector<StatVector>& simulations) {
  const auto y = whiten_all(standard, simulations);
  const int k = static_cast<int>(y.size());
  MeanOfSimulations result;
  result.mean.assign(y[0].size(), 0.f);
  for (const auto& one : y)
    for (std::size_t i = 0; i < one.size(); ++i) result.mean[i] += one[i] / k;
  if (k > 1) {
    const float scale = 1.f / std::sqrt(k * (k - 1.f));
    result.noise = y;
    for (auto& one : result.noise)
      for (std::size_t i = 0; i < one.size(); ++i) one[i] = scale * (one[i] - result.mean[i]);
  }
  return result;
}

Fit fit_model(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
              const SensorModel& start, const std::vector<FitParameter>& parameters, const std::vector<Offset>& offsets,
              const FitOptions& options) {
  const Layout& layout = experiment.layout();
  const int n = static_cast<int>(parameters.size());
  Fit fit;
  fit.parameters = parameters;
  fit.value.resize(n);
  SensorModel first = start;
  for (int p = 0; p < n; ++p)
    fit.value[p] = parameters[p].scaled(find_instance(first, parameters[p].id)->value(parameters[p].name));

  const auto trial = [&](const SensorModel& model, int k) {
    return Trial{model,
                 offsets,
                 options.seed + static_cast<std::uint64_t>(k),
                 options.part,
                 options.most_frames,
                 options.shorten_series};
  };
  const auto prior_part = [&](const Eigen::VectorXd& x) {
    double sum = 0;
    for (int p = 0; p < n; ++p)
      if (!parameters[p].circular) sum += std::pow((x[p] - parameters[p].prior_centre) / parameters[p].prior_sigma, 2);
    return sum;
  };
  struct State {
    SensorModel model;
    std::vector<Whitened> y;
    Whitened residual;
    double chi = 0;
  };
  const auto evaluate = [&](const SensorModel& model, const Eigen::VectorXd& x) {
    State state;
    state.model = model;
    std::vector<Trial> trials;
    for (int k = 0; k < options.seeds; ++k) trials.push_back(trial(state.model, k));
    const auto simulations = experiment.simulate(trials);
    state.y = whiten_all(standard, simulations);
    const MeanOfSimulations mean = mean_of(standard, simulations);
    Whitened difference = data;
    for (int i = 0; i < layout.size; ++i) difference[i] -= mean.mean[i];
    Explained explained = metric.explain(difference, options.place, {}, mean.noise);
    state.residual = std::move(explained.rest);
    state.chi = explained.chi + prior_part(x);
    return state;
  };

  State now = evaluate(with_values(start, parameters, fit.value), fit.value);
  double damping = 1e-3;
  fit.jacobian.resize(n);
  // Change of y per unit; simulated anew unless the last step was short and kept what it promised.
  std::vector<Whitened> slopes;
  const auto simulate_slopes = [&] {
    slopes.resize(n);
    std::vector<Trial> trials;
    std::vector<double> step(n);
    for (int p = 0; p < n; ++p) {
      // Towards the inside of the bounds.
      step[p] = parameters[p].step;
      const double ahead = parameters[p].natural(fit.value[p] + step[p]);
      if (!parameters[p].circular && std::abs(parameters[p].scaled(ahead) - fit.value[p]) < 0.5 * step[p])
        step[p] *= -1;
      Eigen::VectorXd x = fit.value;
      x[p] += step[p];
      for (int k = 0; k < options.seeds; ++k) trials.push_back(trial(with_values(now.model, parameters, x), k));
    }
    const auto y = whiten_all(standard, experiment.simulate(trials, "fitting parameters"));
    parallel_for(n, [&](int p) {
      std::vector<Whitened> differences;
      for (int k = 0; k < options.seeds; ++k) {
        Whitened d = y[p * options.seeds + k];
        for (int i = 0; i < layout.size; ++i) d[i] = static_cast<float>((d[i] - now.y[k][i]) / step[p]);
        differences.push_back(std::move(d));
      }
      slopes[p] = shrunk_mean(layout, differences);
    });
  };
  bool stale = slopes.empty(), fresh = false;
  int simulated_slopes = 0;  // what costs; a step with kept slopes costs one simulation
  for (;;) {
    if (stale && simulated_slopes >= std::max(1, options.iterations)) break;
    if (stale) simulate_slopes(), ++simulated_slopes;
    fresh = stale;
    ++fit.rounds;
    std::vector<Whitened> applied(n);
    parallel_for(n, [&](int p) {
      fit.jacobian[p] = slopes[p];
      for (int i = 0; i < layout.size; ++i) fit.jacobian[p][i] *= compression_slope(now.residual[i]);
      applied[p] = metric.apply(fit.jacobian[p]);
    });
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd b(n);
    for (int p = 0; p < n; ++p) {
      for (int q = 0; q <= p; ++q) a(p, q) = a(q, p) = dot(fit.jacobian[p], applied[q]);
      b[p] = dot(fit.jacobian[p], now.residual);  // the nuisances are out of it already
      const double precision = parameters[p].circular ? 0.01 : 1 / std::pow(parameters[p].prior_sigma, 2);
      a(p, p) += precision;
      if (!parameters[p].circular) b[p] -= precision * (fit.value[p] - parameters[p].prior_centre);
    }
    fit.precision = a;
    if (options.iterations == 0) break;
    bool improved = false;
    double gained = 0, promised = 0;
    for (int attempt = 0; attempt < (fresh ? 5 : 1) && !improved; ++attempt) {
      Eigen::MatrixXd damped = a;
      damped.diagonal() *= 1 + damping;
      Eigen::VectorXd delta = damped.ldlt().solve(b);
      double shorten = 1;
      for (int p = 0; p < n; ++p) shorten = std::max(shorten, std::abs(delta[p]) / parameters[p].longest);
      delta /= std::min(shorten, 3.0);
      for (int p = 0; p < n; ++p) delta[p] = std::clamp(delta[p], -parameters[p].longest, parameters[p].longest);
      Eigen::VectorXd x = fit.value + delta;
      for (int p = 0; p < n; ++p) {
        // A magnitude that falls to zero at once stays there: its derivative is zero, too.
        if (!parameters[p].logarithmic && !parameters[p].circular && parameters[p].lower >= 0 && fit.value[p] > 0)
          x[p] = std::max(x[p], 0.5 * fit.value[p]);
        x[p] = parameters[p].scaled(parameters[p].natural(x[p]));
      }
      promised = delta.dot(2 * b - a * delta);
      if (promised < 0.5 * options.converged) break;
      State next = evaluate(with_values(now.model, parameters, x), x);
      if (next.chi < now.chi) {
        gained = now.chi - next.chi;
        fit.value = x;
        now = std::move(next);
        improved = true;
        damping = std::max(1e-4, damping / 5);
      } else {
        damping = std::max(0.01, 10 * damping);
      }
    }
    if (gained < options.converged && fresh) {
      fit.converged = true;
      break;
    }
    // Slopes of far away lead into the wrong one of two valleys: they are only kept near the end.
    stale = gained < options.converged || gained < 0.5 * promised || gained > 0.01 * now.chi;
  }

  if (!options.scan_ids.empty()) {
    const EffectCatalogue& catalogue = experiment.forward().catalogue();
    for (std::size_t e = 0; e < now.model.effects.size(); ++e) {
      const std::string id = now.model.effects[e].id;
      if (std::find(options.scan_ids.begin(), options.scan_ids.end(), id) == options.scan_ids.end()) continue;
      for (const auto& spec : now.model.effects[e].declaration(catalogue).parameters) {
        if (spec.kind != ParameterKind::integer && spec.interpolate) continue;
        for (double direction : {1.0, -1.0})
          for (int moves = 0; moves < (spec.either_sign ? 5 : 2); ++moves) {
            const double value = now.model.effects[e].value(spec.name);
            const double step = spec.kind == ParameterKind::integer ? std::max(1.0, std::round(0.25 * value))
                                : spec.either_sign                  ? 0.06 * spec.typical_high
                                                                    : 0.2 * value;
            const double other = std::clamp(value + direction * step, spec.lower, spec.upper);
            if (other == value) break;
            SensorModel changed = now.model;
            changed.effects[e].values[spec.name].value = other;
            State next = evaluate(changed, fit.value);
            if (next.chi >= now.chi - 1) break;
            now = std::move(next);
          }
      }
    }
  }
  fit.model = now.model;
  fit.residual = now.residual;
  fit.chi = now.chi;
  if (n == 0) fit.converged = true;
  return fit;
}

void write_intervals(SensorModel& model, const Fit& fit, double dispersion, const std::string& provenance) {
  const int n = static_cast<int>(fit.parameters.size());
  if (n == 0 || fit.precision.rows() != n) return;
  const Eigen::MatrixXd covariance = fit.precision.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  for (int p = 0; p < n; ++p) {
    const auto& parameter = fit.parameters[p];
    auto* instance = find_instance(model, parameter.id);
    if (!instance) continue;
    double deviation = std::sqrt(std::max(0.0, dispersion * covariance(p, p)));
    if (fit.scatter.size() == n) deviation = std::max(deviation, fit.scatter[p]);
    // The simulations that the data were compared with scatter, too: two of them, as far as the data do.
    const double half = 1.96 * std::sqrt(1.5) * deviation;
    auto& value = instance->values[parameter.name];
    value.value = parameter.natural(fit.value[p]);
    if (parameter.circular)
      value.ci95 = {{value.value - half, value.value + half}};
    else
      value.ci95 = {{parameter.natural(fit.value[p] - half), parameter.natural(fit.value[p] + half)}};
    value.provenance = provenance;
  }
}

}  // namespace binrig
