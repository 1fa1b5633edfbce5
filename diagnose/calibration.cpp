#include "diagnose/calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "compare/probability.h"
#include "core/error.h"
#include "core/parallel.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double narrow_enough = 0.6;       // of the prior's standard deviation: below, the recording has spoken
constexpr double near_enough = 2;           // standard deviations: so far the last step is as straight as its slopes
constexpr double straight = 0.25;           // the same: over so much of it, slopes hold
constexpr int seeds = 4, short_frames = 3;  // of derivatives
constexpr double least_signal = 0.3;        // share of a derivative's square that must be more than its own noise
constexpr double chi_95 = 3.84;
const std::string unmoved = "nothing in this recording moves with it";

bool names(const std::vector<std::string>& list, const std::string& id, const std::string& parameter) {
  return std::any_of(list.begin(), list.end(), [&](const auto& n) { return n == id || n == id + "." + parameter; });
}

void check_names(const std::vector<std::string>& list, const SensorModel& model, const EffectCatalogue& catalogue) {
  std::vector<std::string> known;
  for (const auto& instance : model.effects) {
    known.push_back(instance.id);
    for (const auto& spec : instance.declaration(catalogue).parameters) known.push_back(instance.id + "." + spec.name);
  }
  for (const auto& name : list)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw Error(fmt::format("the model has no parameter {}; it has {}", name, fmt::join(known, ", ")));
}

double prior_deviation(const FitParameter& parameter) {
  return parameter.circular ? std::numbers::pi / std::sqrt(3.0) : parameter.prior_sigma;
}

bool silent(const Whitened& slope) {
  return std::all_of(slope.begin(), slope.end(), [](float v) { return v == 0; });
}

ParameterValue& value_in(SensorModel& model, const std::string& id, const std::string& name) {
  for (auto& instance : model.effects)
    if (instance.id == id) return instance.values.at(name);
  throw Error("the model has no " + id);
}

class Calibrator {
 public:
  Calibrator(const Experiment& experiment, const Measurement& measured, const SensorModel& start,
             const CalibrationOptions& options)
      : experiment_(experiment),
        layout_(experiment.layout()),
        catalogue_(experiment.forward().catalogue()),
        measured_(measured),
        start_(start),
        options_(options) {
    check_names(options.fixed, start, catalogue_);
    check_names(options.only, start, catalogue_);
    std::map<std::string, std::string> inactive;
    for (const auto& [id, why] : experiment.forward().inactive(start)) inactive[id] = why;
    for (const auto& instance : start.effects)
      for (const auto& spec : instance.declaration(catalogue_).parameters) {
        const bool wanted = is_fitted(options, instance.id, spec.name) && spec.lower < spec.upper;
        const bool acts = !inactive.contains(instance.id);
        if (!wanted || !acts) rung_options_.fixed.push_back(instance.id + "." + spec.name);
        if (!wanted) continue;
        CalibratedParameter entry{instance.id, spec.name, spec.unit, instance.value(spec.name)};
        entry.value = entry.before;
        if (!acts) entry.reason = inactive[instance.id];
        parameters_.push_back(entry);
        if (acts && (spec.kind == ParameterKind::integer || !spec.interpolate)) steps_.emplace_back(instance.id, &spec);
      }
    if (parameters_.empty()) throw Error("no parameter is left to fit");
    const RegistrationPrior prior = registration_prior(experiment.forward().set(), experiment.nominal(0).camera);
    // What a series shows needs the series.
    series_ = std::any_of(start.effects.begin(), start.effects.end(), [&](const EffectInstance& e) {
      const Needs& needs = e.declaration(catalogue_).needs;
      return needs.power_on || needs.repeats || needs.motion;
    });
    poses_known_ = prior.poses_known;
    motions_ = scene_motions(experiment, start, prior);
    rung_options_.simulations = options.simulations;
    rung_options_.pose_draws = std::max(4, options.simulations / 3);
    rung_options_.passes = options.passes;
    rung_options_.iterations = options.iterations;
    rung_options_.scan_ranges = true;
    rung_options_.seed = options.seed * 100000;
  }

  Calibration run() {
    constexpr int rounds = 3;
    Calibration result;
    result.rung = fit_rung(experiment_, motions_, measured_, start_, {}, rung_options_);
    first_ = result.rung.fit.parameters;
    for (int round = 0;; ++round) {
      newton(result.rung);
      result.converged = furthest_ < near_enough;
      if (result.converged || round + 1 == rounds) break;
      RungOptions again = rung_options_;
      again.passes = 0;
      result.rung = fit_rung(experiment_, motions_, measured_, model_, result.rung.offsets, again);
    }
    result.dispersion = result.rung.dispersion;
    report(result.rung);
    bound_strengths(result.rung);
    for (const auto& [id, spec] : steps_) choose_step(result.rung, id, *spec);
    write();
    result.model = model_;
    result.parameters = parameters_;
    return result;
  }

 private:
  CalibratedParameter& entry_of(const std::string& id, const std::string& name) {
    return *std::find_if(parameters_.begin(), parameters_.end(),
                         [&](const CalibratedParameter& p) { return p.id == id && p.name == name; });
  }
  const CalibratedParameter& entry_of(const std::string& id, const std::string& name) const {
    return const_cast<Calibrator*>(this)->entry_of(id, name);
  }

  /// Derivatives of y by the parameters, one a seed, in captures cut short, and what follows from them. Their own noise
  /// must not pass for information: a direction in which parameters make up for each other would look short, steps
  /// along it stop half way, and intervals be too narrow. So squares are taken between derivatives of different seeds.
  void differentiate(const Rung& rung, const Whitened& slope) {
    const int n = static_cast<int>(first_.size());
    std::vector<Trial> trials;
    const auto add = [&](const SensorModel& model) {
      for (int k = 0; k < seeds; ++k)
        trials.push_back({model, rung.offsets, rung_options_.seed + 700 + static_cast<std::uint64_t>(k), Part::train,
                          short_frames, !series_});
    };
    add(rung.model);
    std::vector<int> asked;
    std::vector<double> taken;
    for (int p = 0; p < n; ++p) {
      const FitParameter& parameter = first_[p];
      if (silent(rung.fit.slopes[p])) continue;
      double step = parameter.step;
      if (!parameter.circular &&
          std::abs(parameter.scaled(parameter.natural(value_[p] + step)) - value_[p]) < 0.5 * step)
        step = -step;
      SensorModel moved = rung.model;
      value_in(moved, parameter.id, parameter.name).value = parameter.natural(value_[p] + step);
      add(moved);
      asked.push_back(p);
      taken.push_back(step);
    }
    const auto simulated = experiment_.simulate(trials, "taking derivatives");
    jacobian_.assign(n, Whitened(layout_.size, 0.f));
    information_ = MatrixXd::Zero(n, n);
    std::vector<std::vector<Whitened>> each(n);
    std::vector<Whitened> whole(n), applied(n);
    parallel_for(static_cast<int>(asked.size()), [&](int m) {
      const int p = asked[m];
      whole[p].assign(layout_.size, 0.f);
      for (int k = 0; k < seeds; ++k) {
        StatVector d = simulated[(m + 1) * seeds + k];
        for (int i = 0; i < layout_.size; ++i) d[i] = (d[i] - simulated[k][i]) / static_cast<float>(taken[m]);
        each[p].push_back(rung.standard.difference(d));
        for (int i = 0; i < layout_.size; ++i) {
          each[p][k][i] *= slope[i];
          whole[p][i] += each[p][k][i] / seeds;
        }
      }
      // Segments in which a derivative is mostly noise are left out.
      std::vector<double> signal(segments().size(), 0), noise(segments().size(), 0);
      for (const auto& block : layout_.blocks)
        for (int i = block.offset; i < block.offset + block.size; ++i) {
          signal[block.segment] += static_cast<double>(whole[p][i]) * whole[p][i];
          for (const auto& d : each[p])
            noise[block.segment] += std::pow(d[i] - whole[p][i], 2) / (seeds * (seeds - 1.0));
        }
      for (const auto& block : layout_.blocks)
        if (noise[block.segment] < (1 - least_signal) * signal[block.segment])
          std::copy_n(whole[p].begin() + block.offset, block.size, jacobian_[p].begin() + block.offset);
      applied[p] = metric_.apply(jacobian_[p]);
    });
    const auto counted = [&](const Whitened& like, const Whitened& all) {
      Whitened part = all;
      for (std::size_t i = 0; i < part.size(); ++i)
        if (like[i] == 0) part[i] = 0;
      return part;
    };
    for (int p : asked)
      for (int q : asked) information_(p, q) = seeds * seeds * dot(applied[p], whole[q]);
    std::vector<MatrixXd> own(seeds, MatrixXd::Zero(n, n));
    parallel_for(seeds, [&](int k) {
      for (int p : asked) {
        const Whitened part = metric_.apply(counted(jacobian_[p], each[p][k]));
        for (int q : asked) own[k](p, q) = dot(part, each[q][k]);
      }
    });
    for (const auto& o : own) information_ -= o;
    information_ /= seeds * (seeds - 1.0);
    information_ = (0.5 * (information_ + information_.transpose())).eval();
    MatrixXd together = MatrixXd::Zero(n, n);
    for (int p : asked)
      for (int q : asked) together(p, q) = dot(applied[p], jacobian_[q]);
    for (int p = 0; p < n; ++p)
      if (applied[p].empty() || information_(p, p) < least_signal * together(p, p)) {
        information_.row(p).setZero(), information_.col(p).setZero();
        together.row(p).setZero(), together.col(p).setZero();
        std::fill(jacobian_[p].begin(), jacobian_[p].end(), 0.f);
      }
    // Direction by direction; where even that is mostly noise, no less than a tenth of what it seems.
    VectorXd scale(n);
    for (int p = 0; p < n; ++p) scale[p] = prior_deviation(first_[p]);
    const Eigen::SelfAdjointEigenSolver<MatrixXd> directions(scale.asDiagonal() * together * scale.asDiagonal());
    const MatrixXd axes = scale.cwiseInverse().asDiagonal() * directions.eigenvectors();
    const MatrixXd ends = scale.asDiagonal() * directions.eigenvectors();
    VectorXd squares(n);
    for (int d = 0; d < n; ++d)
      squares[d] = std::max(ends.col(d).dot(information_ * ends.col(d)), 0.1 * directions.eigenvalues()[d]);
    information_ = axes * squares.asDiagonal() * axes.transpose();
    for (int p = 0; p < n; ++p)
      if (together(p, p) == 0) information_.row(p).setZero(), information_.col(p).setZero();
  }

  /// One more step, against the mean of the model's own simulations, and the covariance of that very step.
  void newton(const Rung& rung) {
    const int n = static_cast<int>(first_.size());
    model_ = rung.model;
    furthest_ = 0;
    if (n == 0) return;
    value_ = rung.fit.value;
    rows_ = motion_rows(layout_, rung.standard, motions_);
    metric_ = Metric(layout_, Part::train, rows_);
    const Whitened rest = metric_.explain(rung.data, place_of(rung)).rest;
    Whitened slope(rest.size());
    for (std::size_t i = 0; i < rest.size(); ++i) slope[i] = compression_slope(rest[i]);
    differentiate(rung, slope);
    const auto gradient = [&](const Whitened& residual) {
      VectorXd g(n);
      for (int p = 0; p < n; ++p) g[p] = dot(jacobian_[p], residual);
      return g;
    };
    VectorXd precision(n), pull(n);
    for (int p = 0; p < n; ++p) {
      precision[p] = first_[p].circular ? 0.01 : 1 / std::pow(first_[p].prior_sigma, 2);
      pull[p] = first_[p].circular ? 0 : -precision[p] * (value_[p] - first_[p].prior_centre);
    }
    const int count = static_cast<int>(rung.nulls.size());
    MatrixXd gradients(count, n);
    parallel_for(count, [&](int k) { gradients.row(k) = gradient(metric_.explain(rung.nulls[k]).rest).transpose(); });
    // Compression moves the mean of what is skewed: of the recording as of the simulations.
    const VectorXd bias = gradients.colwise().mean().transpose();
    const MatrixXd centred = gradients.rowwise() - bias.transpose();
    MatrixXd scatter = rung.dispersion * (1 + 1.0 / count) * (centred.transpose() * centred) / (count - 1.0);
    scatter.diagonal() += precision;
    MatrixXd a = information_;
    a.diagonal() += precision;
    const MatrixXd inverse = a.partialPivLu().inverse();
    covariance_ = inverse * scatter * inverse.transpose();
    freedom_ = count - 1;

    std::vector<bool> stays(n, false);
    for (int p = 0; p < n; ++p) {
      // A parameter of which the recording knows little is led by the noise of its slope, and where there is one, over
      // more than a straight line's length. It stays where two simulations put it.
      stays[p] = std::sqrt(covariance_(p, p)) > straight * prior_deviation(first_[p]);
      if (stays[p]) covariance_.row(p) *= std::sqrt(1.5), covariance_.col(p) *= std::sqrt(1.5);
    }
    const VectorXd step = bounded_solution(a, gradient(rest) - bias + pull, stays);
    value_ += step;
    for (int p = 0; p < n; ++p) {
      if (tracing())
        fmt::print(stderr, "last step {}.{}: {:.5g} by {:.5g}, standard deviation {:.5g}\n", first_[p].id,
                   first_[p].name, value_[p], step[p], std::sqrt(covariance_(p, p)));
      furthest_ = std::max(furthest_, std::abs(step[p]) / std::sqrt(std::max(covariance_(p, p), 1e-300)));
      value_in(model_, first_[p].id, first_[p].name).value = first_[p].natural(value_[p]);
    }
  }

  std::vector<double> place_of(const Rung& rung) const {
    return {rung.place.begin(), rung.place.begin() + static_cast<long>(motions_.size())};
  }

  /// Solves slope * delta = pull; where a bound stops a parameter short, the others are solved for again with it there.
  VectorXd bounded_solution(const MatrixXd& slope, const VectorXd& pull, const std::vector<bool>& stays) const {
    const int n = static_cast<int>(pull.size());
    VectorXd delta = VectorXd::Zero(n);
    std::vector<int> free, stopped;
    for (int p = 0; p < n; ++p) (stays[p] ? stopped : free).push_back(p);
    while (!free.empty()) {
      const int m = static_cast<int>(free.size());
      MatrixXd a(m, m);
      VectorXd b(m);
      for (int i = 0; i < m; ++i) {
        b[i] = pull[free[i]];
        for (int q : stopped) b[i] -= slope(free[i], q) * delta[q];
        for (int j = 0; j < m; ++j) a(i, j) = slope(free[i], free[j]);
      }
      const VectorXd solved = a.partialPivLu().solve(b);
      std::vector<int> left;
      for (int i = 0; i < m; ++i) {
        const FitParameter& parameter = first_[free[i]];
        double reached = std::clamp(solved[i], -parameter.longest, parameter.longest);
        if (!parameter.circular)
          reached = parameter.scaled(parameter.natural(value_[free[i]] + reached)) - value_[free[i]];
        delta[free[i]] = reached;
        (std::abs(reached - solved[i]) > 1e-9 + 0.01 * std::abs(solved[i]) ? stopped : left).push_back(free[i]);
      }
      if (left.size() == free.size()) break;
      free = left;
    }
    return delta;
  }

  /// Share of what the recording says about a parameter that is left if nothing is known of the targets' places.
  double share_beyond_places(int p) const {
    std::vector<NuisanceRow> free = rows_;
    for (auto& row : free)
      for (float& v : row.change) v *= 50;  // of the prior's sigmas: as good as no prior
    const double known = dot(metric_.apply(jacobian_[p]), jacobian_[p]);
    return known > 0 ? dot(Metric(layout_, Part::train, free).apply(jacobian_[p]), jacobian_[p]) / known : 0;
  }

  void report(const Rung& rung) {
    const int n = static_cast<int>(first_.size());
    const double t = student_threshold(0.05, freedom_);
    for (int p = 0; p < n; ++p) {
      const FitParameter& parameter = first_[p];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const double sd = std::sqrt(std::max(0.0, covariance_(p, p)));
      entry.value = parameter.natural(value_[p]);
      entry.narrowing = std::min(1.0, sd / prior_deviation(parameter));
      if (silent(rung.fit.slopes[p])) {
        entry.reason = unmoved;
      } else if (information_(p, p) == 0) {
        entry.reason = "this recording says hardly anything about it";
      } else if (entry.narrowing >= narrow_enough) {
        int rival = -1;
        double closest = 0.9;
        for (int q = 0; q < n; ++q) {
          const double c = std::abs(covariance_(p, q)) / std::sqrt(covariance_(p, p) * covariance_(q, q));
          if (q != p && c > closest) closest = c, rival = q;
        }
        entry.reason = rival < 0 ? "this recording says hardly anything about it"
                                 : fmt::format("only together with {}.{}", first_[rival].id, first_[rival].name);
      } else if (!poses_known_ && share_beyond_places(p) < 0.1) {
        entry.reason = "targets that stand elsewhere look the same, and nobody knows where they stand";
      } else if (parameter.circular) {
        entry.ci95 = {{entry.value - t * sd, entry.value + t * sd}};
      } else {
        entry.ci95 = {{parameter.natural(value_[p] - t * sd), parameter.natural(value_[p] + t * sd)}};
      }
    }
  }

  /// Effects fade away long before their strength is nothing. There slopes say nothing, or how far a strength is above
  /// that, and not that nothing would do as well: values are tried, the other parameters following by their slopes.
  void bound_strengths(const Rung& rung) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t p = 0; p < first_.size(); ++p) {
      const FitParameter& parameter = first_[p];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const EffectDeclaration& declaration = model_.find(entry.id)->declaration(catalogue_);
      const ParameterSpec* spec = declaration.parameter(entry.name);
      if (entry.name != declaration.amplitude || !spec->neutral || entry.reason == unmoved) continue;
      const double neutral = *spec->neutral, strong = spec->either_sign && entry.value < 0 ? -spec->typical_high
                                                      : neutral < spec->typical_low        ? spec->typical_high
                                                                                           : spec->typical_low;
      if (entry.determined() && (*entry.ci95)[0] <= neutral && neutral <= (*entry.ci95)[1]) continue;
      if (!std::isfinite(least)) least = refit(rung, model_, -1).chi;
      const auto at = [&](double value) {
        SensorModel changed = model_;
        value_in(changed, entry.id, entry.name).value = value;
        Fit fit = refit(rung, changed, static_cast<int>(p));
        if (tracing())
          fmt::print(stderr, "{}.{} = {:.4g}: chi + {:.1f}\n", entry.id, entry.name, value, fit.chi - least);
        return fit;
      };
      const double limit = least + chi_95 * rung.dispersion;
      const Fit without = at(neutral);
      if (without.chi > limit) continue;
      double end = entry.determined() ? (*entry.ci95)[strong > neutral ? 1 : 0] : entry.value;
      if (!entry.determined()) {
        if (at(strong).chi < limit) continue;
        double too_far = strong;
        for (int halving = 0; halving < 5; ++halving) {
          const double middle = 0.5 * (end + too_far);
          (at(middle).chi < limit ? end : too_far) = middle;
        }
        end = too_far;
      }
      entry.ci95 = {{std::min(neutral, end), std::max(neutral, end)}};
      entry.reason.clear();
      entry.narrowing = std::min(1.0, std::abs(end - neutral) / std::abs(strong - neutral));
      if (without.chi < least) adopt(without, static_cast<int>(p), neutral);
    }
  }

  /// A fit with a parameter at a value is better than the one so far: the others' intervals go along, and grow by what
  /// two simulations scatter.
  void adopt(const Fit& fit, int p, double value) {
    for (std::size_t q = 0; q < fit.parameters.size(); ++q) {
      const FitParameter& parameter = fit.parameters[q];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const double before = parameter.circular ? entry.value : parameter.scaled(entry.value);
      const double after = fit.value[static_cast<int>(q)];
      entry.value = parameter.natural(after);
      for (double& end : *entry.ci95) {
        const double half = std::sqrt(1.5) * ((parameter.circular ? end : parameter.scaled(end)) - before);
        end = parameter.circular ? entry.value + half : parameter.natural(after + half);
      }
    }
    entry_of(first_[p].id, first_[p].name).value = value;
    model_ = fit.model;
  }

  /// All parameters that are determined, but one, fitted again to all frames.
  Fit refit(const Rung& rung, const SensorModel& model, int without) const {
    std::vector<FitParameter> parameters;
    std::vector<Whitened> slopes;
    for (std::size_t p = 0; p < first_.size(); ++p) {
      if (static_cast<int>(p) == without || !entry_of(first_[p].id, first_[p].name).determined()) continue;
      parameters.push_back(first_[p]);
      slopes.push_back(rung.fit.slopes[p]);
    }
    FitOptions options = quick(rung);
    options.slopes = &slopes;
    options.iterations = 0;
    return fit_model(experiment_, rung.standard, metric_, rung.data, model, parameters, rung.offsets, options);
  }

  FitOptions quick(const Rung& rung) const {
    FitOptions options;
    options.seed = rung_options_.seed + 500;
    options.place = place_of(rung);
    return options;
  }

  double chi_with(const Rung& rung, const std::string& id, const std::string& name, double value) const {
    SensorModel changed = model_;
    value_in(changed, id, name).value = value;
    return fit_model(experiment_, rung.standard, metric_, rung.data, changed, {}, rung.offsets, quick(rung)).chi;
  }

  /// Values between which nothing moves smoothly are tried one by one: whole numbers by ones, others by factors. The
  /// interval is where chi is within 95 % of the best one's.
  void choose_step(const Rung& rung, const std::string& id, const ParameterSpec& spec) {
    if (metric_.part() != Part::train) {
      rows_ = motion_rows(layout_, rung.standard, motions_);
      metric_ = Metric(layout_, Part::train, rows_);
    }
    double best = model_.find(id)->value(spec.name);
    const bool whole = spec.kind == ParameterKind::integer;
    std::map<double, double> seen;
    const auto ask = [&](double at) {
      at = std::clamp(whole ? std::round(at) : at, spec.lower, spec.upper);
      const auto known = seen.find(at);
      const double chi = known != seen.end() ? known->second : seen[at] = chi_with(rung, id, spec.name, at);
      if (chi < seen.at(best)) best = at;
    };
    seen[best] = chi_with(rung, id, spec.name, best);
    const double scale = std::abs(spec.typical_high - spec.typical_low);
    const auto away = [&](double at, int k) {
      if (whole) return at + k;
      const double share = std::copysign(std::array{0.0, 0.004, 0.016, 0.06}[std::abs(k)], k);
      return spec.log_scaled && at > 0 ? at * std::exp(share) : at + share * scale;
    };
    for (int moves = 0; moves < 4; ++moves) {
      const double middle = best;
      for (int k : whole ? std::vector{-1, 1} : std::vector{-3, -2, -1, 1, 2, 3}) ask(away(middle, k));
      if (best == middle) break;
    }
    const double least = seen.at(best), limit = least + chi_95 * rung.dispersion;
    if (std::all_of(seen.begin(), seen.end(), [&](const auto& s) { return s.second < limit; }))
      for (double far : {spec.typical_low, spec.typical_high}) ask(far);
    value_in(model_, id, spec.name).value = best;
    CalibratedParameter& entry = entry_of(id, spec.name);
    entry.value = best;
    if (std::all_of(seen.begin(), seen.end(), [&](const auto& s) { return s.second < limit; })) {
      entry.reason = "this recording says hardly anything about it";
      return;
    }
    // Between the last value that holds and the first that does not, the bound is anywhere.
    double low = spec.lower, high = spec.upper;
    for (const auto& [at, chi] : seen) {
      if (chi < limit) continue;
      if (at < best) low = std::max(low, whole ? at + 1 : at);
      if (at > best) high = std::min(high, whole ? at - 1 : at);
    }
    entry.ci95 = {{low, high}};
    entry.narrowing = std::min(1.0, (high - low) / std::max(scale, 1e-12));
  }

  void write() {
    for (const auto& entry : parameters_)
      value_in(model_, entry.id, entry.name) = {entry.value, entry.ci95,
                                                entry.determined()
                                                    ? "fitted: " + options_.provenance
                                                    : "not determined by " + options_.provenance + ": " + entry.reason};
  }

  const Experiment& experiment_;
  const Layout& layout_;
  const EffectCatalogue& catalogue_;
  const Measurement& measured_;
  const SensorModel& start_;
  const CalibrationOptions& options_;
  RungOptions rung_options_;
  std::vector<CalibratedParameter> parameters_;
  std::vector<std::pair<std::string, const ParameterSpec*>> steps_;
  std::vector<SceneMotion> motions_;
  bool poses_known_ = false, series_ = false;

  std::vector<FitParameter> first_;  // priors stand where the user began
  SensorModel model_;
  std::vector<NuisanceRow> rows_;
  Metric metric_;
  std::vector<Whitened> jacobian_;
  VectorXd value_;
  MatrixXd information_, covariance_;
  double freedom_ = 1, furthest_ = 0;
};

}  // namespace

bool is_fitted(const CalibrationOptions& options, const std::string& id, const std::string& parameter) {
  return !names(options.fixed, id, parameter) && (options.only.empty() || names(options.only, id, parameter));
}

Calibration calibrate(const Experiment& experiment, const Measurement& measured, const SensorModel& start,
                      const CalibrationOptions& options) {
  return Calibrator(experiment, measured, start, options).run();
}

}  // namespace binrig
