#include "diagnose/descent.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "core/parallel.h"
#include "diagnose/mean_of_simulations.h"
#include "diagnose/trace.h"

namespace binrig {

namespace {

constexpr int most_rounds = 60;  // a step so short that it goes on for longer leads to where nobody wants to be
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

double prior_precision(const FitParameter& parameter) {
  return parameter.circular ? 0.01 : 1 / std::pow(parameter.prior_sigma, 2);
}

}  // namespace

Descent::Descent(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
                 std::vector<FitParameter> parameters, const SensorModel& start, const std::vector<Offset>& offsets,
                 const FitOptions& options)
    : experiment_(experiment),
      standard_(standard),
      metric_(metric),
      data_(data),
      options_(options),
      parameters_(std::move(parameters)),
      n_(static_cast<int>(parameters_.size())),
      slopes_(experiment, standard, options, parameters_, now_, fit_) {
  now_.model = start;
  now_.offsets = offsets;
  now_.place = options_.place;
  now_ = evaluate(values_of_model());
}

Eigen::VectorXd Descent::values_of_model() const {
  Eigen::VectorXd value(n_);
  for (int p = 0; p < n_; ++p)
    value[p] = parameters_[p].scaled(now_.model.find(parameters_[p].id)->value(parameters_[p].name));
  return value;
}

FitState Descent::evaluate(const Eigen::VectorXd& value) const {
  return evaluate(with_values(now_.model, parameters_, value), value);
}

FitState Descent::evaluate(const std::string& id, const std::string& name, double value) const {
  SensorModel model = now_.model;
  value_in(model, id, name).value = value;
  return evaluate(model, now_.value);
}

void Descent::also_fit(const std::vector<FitParameter>& more) {
  parameters_.insert(parameters_.end(), more.begin(), more.end());
  n_ = static_cast<int>(parameters_.size());
  now_ = evaluate(now_.model, values_of_model());  // with their priors
}

Fit Descent::result() && {
  fit_.parameters = std::move(parameters_);
  fit_.model = std::move(now_.model);
  fit_.value = std::move(now_.value);
  fit_.offsets = std::move(now_.offsets);
  fit_.place = std::move(now_.place);
  fit_.simulations = std::move(now_.simulations);
  fit_.residual = std::move(now_.residual);
  fit_.chi = now_.chi;
  fit_.dispersion = now_.dispersion;
  return std::move(fit_);
}

FitState Descent::evaluate_and_follow(const std::string& id, const std::string& name, double value) const {
  FitState state = evaluate(id, name, value);
  const bool has_slopes = n_ > 0 && static_cast<int>(fit_.seed_slopes.size()) == n_;
  if (!has_slopes || now_.dispersion > far_off) return state;
  const auto acts_widely = acting_widely();  // the others are rough, and followed it nowhere
  double gained = std::numeric_limits<double>::infinity();
  // As long as it may still come to what is known, or below it.
  while (gained > least_gain * now_.dispersion && state.chi - now_.chi < 4 * gained) {
    Eigen::MatrixXd a;
    Eigen::VectorXd b, lower, upper;
    linearise(state, a, b);
    box(state.value, lower, upper);
    const Eigen::VectorXd step = minimum_in_box(a, b, acts_widely.select(lower, 0), acts_widely.select(upper, 0));
    gained = 0;
    for (double share = 1; share > 0.2 && gained <= 0; share /= 2) {
      const Eigen::VectorXd x = within_bounds(state.value + share * step);
      FitState next = evaluate(with_values(state.model, parameters_, x), x);
      gained = state.chi - next.chi;
      if (gained > 0) state = std::move(next);
    }
  }
  return state;
}

FitState Descent::evaluate(const SensorModel& model, const Eigen::VectorXd& x) const {
  FitState state;
  state.model = model;
  state.value = x;
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
Explained Descent::explain(FitState& state) const {
  std::vector<Trial> trials;
  for (int k = 0; k < options_.seeds; ++k) trials.push_back(trial_of(options_, state.model, state.offsets, k));
  MeanOfSimulations mean =
      mean_of(standard_, simulate_typical_units(experiment_, trials, "fitting parameters", &state.simulations));
  Whitened difference = data_;
  for (std::size_t i = 0; i < difference.size(); ++i) difference[i] -= mean.mean[i];
  state.noise = std::move(mean.noise);
  return metric_.explain(difference, state.place, {}, state.noise);
}

/// Moves the targets of a state to where they want to be; false if they stand there.
bool Descent::moved(const Explained& explained, FitState& state) const {
  if (!options_.motions || state.place.size() < options_.motions->size()) return false;
  const std::size_t count = options_.motions->size();
  std::vector<double> values(state.place.begin(), state.place.begin() + static_cast<long>(count));
  double furthest = 0;
  for (std::size_t m = 0; m < count; ++m) {
    if (explained.values[m] == 0) continue;  // of a capture that does not count
    furthest = std::max(furthest, std::abs(explained.values[m] - values[m]) / registered_to((*options_.motions)[m]));
    values[m] = explained.values[m];
  }
  if (furthest < 1) return false;
  auto offsets = offsets_of(experiment_.layout(), *options_.motions, values, {});
  const auto reached = values_of(*options_.motions, offsets);
  double step = 0;
  for (std::size_t m = 0; m < count; ++m)
    step = std::max(step, std::abs(reached[m] - state.place[m]) / registered_to((*options_.motions)[m]));
  if (step < 1) return false;  // what is no small motion was clipped
  state.offsets = std::move(offsets);
  std::copy(reached.begin(), reached.end(), state.place.begin());
  return true;
}

/// Normal equations of the next step. A simulation that scatters more has derivatives that scatter along, so that
/// those of each seed are only held against what the other seeds leave of the data.
void Descent::linearise(const FitState& state, Eigen::MatrixXd& a, Eigen::VectorXd& b) const {
  const int seeds = options_.seeds;
  const Pull pull(state.residual);
  std::vector<Whitened> left(seeds, pull.direct());
  if (seeds > 1)
    parallel_for(seeds, [&](int k) {
      const Whitened own = metric_.apply(state.noise[k]);
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
    const double precision = prior_precision(parameters_[p]);
    a(p, p) += precision;
    if (!parameters_[p].circular) b[p] -= precision * (state.value[p] - parameters_[p].prior_centre);
  }
}

/// Pauses what the data say nothing of, and takes derivatives of narrow parameters over ten standard deviations.
void Descent::look_at_information(const Eigen::MatrixXd& a) {
  for (int p = 0; p < n_; ++p) {
    const double precision = prior_precision(parameters_[p]), information = a(p, p) - precision;
    if (information < pause_below * precision) fit_.paused[p] = true;
    if (parameters_[p].narrow && information > 0)
      parameters_[p].step = std::clamp(10 / std::sqrt(information), parameters_[p].step / 5, parameters_[p].step * 2);
  }
}

/// How far parameters may go in one step.
void Descent::box(const Eigen::VectorXd& value, Eigen::VectorXd& lower, Eigen::VectorXd& upper) const {
  lower.resize(n_);
  upper.resize(n_);
  for (int p = 0; p < n_; ++p) {
    const FitParameter& parameter = parameters_[p];
    lower[p] = -parameter.longest;
    upper[p] = parameter.longest;
    if (parameter.circular) continue;
    lower[p] = std::max(lower[p], std::min(0.0, parameter.scaled(parameter.lower) - value[p]));
    upper[p] = std::min(upper[p], std::max(0.0, parameter.scaled(parameter.upper) - value[p]));
    // A magnitude that falls to zero at once stays there: its derivative is zero, too.
    if (!parameter.logarithmic && parameter.lower >= 0 && value[p] > 0) lower[p] = std::max(lower[p], -0.5 * value[p]);
  }
}

/// Lets narrow parameters that stand at the limit of a step go twice as far; false if there are none.
bool Descent::widen(const Eigen::VectorXd& delta) {
  bool any = false;
  for (int p = 0; p < n_; ++p) {
    FitParameter& parameter = parameters_[p];
    if (!parameter.narrow || std::abs(delta[p]) < 0.99 * parameter.longest) continue;
    parameter.longest *= 2;
    any = true;
  }
  return any;
}

/// Parameters with a trace in more than half of the captures.
Eigen::Array<bool, Eigen::Dynamic, 1> Descent::acting_widely() const {
  const Layout& layout = experiment_.layout();
  const auto acts = [](const Whitened& slope, const Block& block) {
    const auto begin = slope.begin() + block.offset;
    return std::any_of(begin, begin + block.size, [](float v) { return v != 0; });
  };
  Eigen::Array<bool, Eigen::Dynamic, 1> result(n_);
  for (int p = 0; p < n_; ++p) {
    std::set<int> captures;
    for (const Block& block : layout.blocks)
      if (acts(fit_.slopes[p], block)) captures.insert(block.capture);
    result[p] = 2 * static_cast<int>(captures.size()) > layout.captures;
  }
  return result;
}

Eigen::VectorXd Descent::within_bounds(Eigen::VectorXd x) const {
  for (int p = 0; p < n_; ++p)
    if (!parameters_[p].circular) x[p] = parameters_[p].scaled(parameters_[p].natural(x[p]));
  return x;
}

double Descent::stretch(const Eigen::VectorXd& from) {
  const double chi = now_.chi;
  for (;;) {
    const Eigen::VectorXd x = within_bounds(now_.value + (now_.value - from));
    if (x == now_.value) break;
    FitState next = evaluate(x);
    if (next.chi > now_.chi - least_gain) break;
    now_ = std::move(next);
  }
  return chi - now_.chi;
}

void Descent::run() {
  fit_.paused.assign(n_, false);
  if (n_ == 0) {
    fit_.converged = true;
    return;
  }
  double damping = 1e-3;
  const bool given = options_.nearby && static_cast<int>(options_.nearby->slopes.size()) == n_;
  bool stale = !given;
  if (given) fit_.slopes = options_.nearby->slopes, fit_.seed_slopes = options_.nearby->seed_slopes;
  for (int simulated_slopes = 0; fit_.rounds < most_rounds; ++fit_.rounds) {
    if (stale && simulated_slopes >= std::max(options_.iterations, given ? 0 : 1)) return;
    if (stale) slopes_.run(), ++simulated_slopes;
    const bool fresh = stale;
    Eigen::MatrixXd a;
    Eigen::VectorXd b, lower, upper;
    linearise(now_, a, b);
    look_at_information(a);
    fit_.precision = a;
    if (options_.iterations == 0 && !given) return;
    const auto acts_widely = acting_widely();
    const double worth_a_try = options_.converged * now_.dispersion,
                 enough = std::max(worth_a_try, now_.dispersion > far_off ? options_.converged_far_off * now_.chi : 0);
    double gained = 0, promised = 0;
    const Eigen::VectorXd from = now_.value;
    // Chi is rough along what acts in a few captures: that must not keep all others from going.
    const bool mixed = acts_widely.any() && !acts_widely.all();
    const int attempts = fresh ? 6 : options_.iterations == 0 ? 4 : 2;
    for (int attempt = 0; attempt < attempts && gained == 0; ++attempt) {
      Eigen::MatrixXd damped = a;
      damped.diagonal() *= 1 + damping;
      const bool smooth = mixed && attempt % 2 == 1;
      const auto in_box = [&](const Eigen::VectorXd& end) -> Eigen::VectorXd {
        return smooth ? Eigen::VectorXd(acts_widely.select(end, 0)) : end;
      };
      Eigen::VectorXd delta;
      do {
        box(from, lower, upper);
        delta = minimum_in_box(damped, b, in_box(lower), in_box(upper));
        promised = delta.dot(2 * b - a * delta);
      } while (promised < 0.5 * worth_a_try && widen(delta));
      if (promised < 0.5 * worth_a_try) break;
      FitState next = evaluate(from + delta);
      if (next.chi < now_.chi) {
        gained = now_.chi - next.chi;
        now_ = std::move(next);
        damping = std::max(1e-4, damping / 5);
      } else if (smooth || !mixed) {
        damping = std::max(0.01, 10 * damping);
      }
    }
    if (gained > 0.5 * promised) widen(now_.value - from);
    if (gained > 2 * promised) gained += stretch(from);
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

}  // namespace binrig
