#include "diagnose/signatures.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <tuple>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "core/parallel.h"
#include "diagnose/slopes.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double least_of_signal = 0.67;  // of a segment of a signature that must be signal

struct Place {
  int hypothesis, path, atom;
};

/// Largest of 2 b'w - w'Gw along the broken line from 0 through the unit vectors in turn; w holds the place.
double best_on_path(const Eigen::MatrixXd& gram, const Eigen::VectorXd& b, bool interpolate, Eigen::VectorXd& w) {
  const int n = static_cast<int>(b.size());
  double best = 0;
  w = Eigen::VectorXd::Zero(n);
  for (int j = 0; j < n; ++j) {
    if (!interpolate) {
      const double gain = 2 * b[j] - gram(j, j);
      if (gain > best) best = gain, w = Eigen::VectorXd::Unit(n, j);
      continue;
    }
    // Point p + t d with p = e_{j-1} (or 0), d = e_j - p, t in 0..1 (the last piece goes on to 1.5).
    Eigen::VectorXd p =
        j > 0 ? Eigen::VectorXd(Eigen::VectorXd::Unit(n, j - 1)) : Eigen::VectorXd(Eigen::VectorXd::Zero(n));
    const Eigen::VectorXd d = Eigen::VectorXd::Unit(n, j) - p;
    const double slope = d.dot(b) - d.dot(gram * p), curvature = d.dot(gram * d);
    const double t = curvature > 0 ? std::clamp(slope / curvature, 0.0, j == n - 1 ? 1.5 : 1.0) : 0;
    const Eigen::VectorXd x = p + t * d;
    const double gain = 2 * x.dot(b) - x.dot(gram * x);
    if (gain > best) best = gain, w = x;
  }
  return best;
}

}  // namespace

StatVector shrunk_change(const Layout& layout, const std::vector<float>& spread, const std::vector<StatVector>& with,
                         const std::vector<StatVector>& without, double map_share) {
  std::vector<StatVector> changes = with;
  for (std::size_t k = 0; k < with.size(); ++k)
    for (int i = 0; i < layout.size; ++i) changes[k][i] -= without[k][i];
  fill_unknown(layout, changes, true);
  for (StatVector& change : changes)
    for (int i = 0; i < layout.size; ++i)
      change[i] = spread[i] == 0 || std::isnan(change[i]) ? 0.f : change[i] / spread[i];
  pool_noisy(layout, spread, std::max(map_share, least_of_signal), changes);
  StatVector mean = shrunk(layout, mean_over_seeds(layout, changes), least_of_signal);
  for (int i = 0; i < layout.size; ++i) mean[i] *= spread[i];
  return mean;
}

SensorModel signature_model(const SensorModel& given, const SensorModel& fitted, const EffectCatalogue& catalogue) {
  SensorModel model = given;
  for (EffectInstance& effect : model.effects) {
    const EffectDeclaration& declaration = effect.declaration(catalogue);
    const ParameterSpec* spec = declaration.parameter(declaration.amplitude);
    const EffectInstance* other = fitted.find(effect.id);
    if (!spec || !spec->log_scaled || !other) continue;
    double& value = effect.values[spec->name].value;
    const double target = other->value(spec->name);
    if (value > 0 && target > 0)
      value = std::clamp(value * std::exp2(std::round(std::log2(target / value))), spec->lower, spec->upper);
  }
  return model;
}

SignatureBook::SignatureBook(const Experiment& experiment, SensorModel model, const Hypotheses& hypotheses,
                             const SignatureOptions& options)
    : experiment_(experiment), model_(std::move(model)), hypotheses_(hypotheses), options_(options) {
  for (const bool series : {false, true}) without_[series] = without(model_, series, options_.shared);
  spread_ = Standard(experiment.layout(), StatVector(experiment.layout().size, 0.f), without_[true]).spread();
}

std::vector<StatVector> SignatureBook::without(const SensorModel& model, bool series, bool shared) const {
  constexpr int for_spread = 6;
  std::vector<Trial> trials;
  for (int s = 0; s < (series ? std::max(for_spread, options_.rare_seeds) : options_.seeds); ++s)
    trials.push_back(trial(model, s, series));
  return experiment_.simulate(trials, "simulating what effects would change", shared);
}

Trial SignatureBook::trial(const SensorModel& model, int seed, bool series) const {
  Trial t{model, {}, options_.seed + static_cast<std::uint64_t>(seed), Part::train, options_.most_frames};
  t.shorten_series = !series;
  t.only = options_.only;
  return t;
}

void SignatureBook::look_at(const std::vector<int>& hypotheses, bool detail) {
  const EffectCatalogue& catalogue = experiment_.forward().catalogue();
  std::vector<Place> places;
  for (int h : hypotheses)
    for (int p = 0; p < static_cast<int>(hypotheses_.tested[h].paths.size()); ++p)
      for (int a = 0; a < static_cast<int>(hypotheses_.tested[h].paths[p].atoms.size()); ++a)
        if (hypotheses_.tested[h].paths[p].detail == detail) places.push_back({h, p, a});

  if (tracing()) {
    std::map<std::string, int> atoms;
    for (const Place& place : places) ++atoms[hypotheses_.tested[place.hypothesis].effect];
    fmt::print(stderr, "signatures, {}:", detail ? "details" : "first");
    for (const auto& [effect, count] : atoms) fmt::print(stderr, " {} {}", effect, count);
    fmt::print(stderr, "\n");
  }
  std::vector<Signature> found(places.size());
  constexpr int batch = 24;
  for (int first = 0; first < static_cast<int>(places.size()); first += batch) {
    const int last = std::min<int>(first + batch, static_cast<int>(places.size()));
    std::vector<Trial> trials;
    std::vector<bool> series;  // only run in full for effects that live on time
    std::vector<long> begins;  // of a place's trials
    for (int i = first; i < last; ++i) {
      const Hypothesis& hypothesis = hypotheses_.tested[places[i].hypothesis];
      const Needs& needs = hypothesis.declaration->needs;
      series.push_back(needs_whole_series(needs));
      const SensorModel extended = with_effect(model_, catalogue, hypothesis.effect,
                                               hypothesis.paths[places[i].path].atoms[places[i].atom].values);
      begins.push_back(static_cast<long>(trials.size()));
      const int seeds = hypothesis.paths[places[i].path].one_of_many ? 1
                        : needs.repeats                              ? options_.rare_seeds
                                                                     : options_.seeds;
      for (int s = 0; s < seeds; ++s) trials.push_back(trial(extended, s, series.back()));
    }
    begins.push_back(static_cast<long>(trials.size()));
    const auto with = experiment_.simulate(trials, "simulating what effects would change", options_.shared);
    parallel_for(last - first, [&](int i) {
      const std::vector<StatVector> own(with.begin() + begins[i], with.begin() + begins[i + 1]);
      found[first + i] = {places[first + i].hypothesis, places[first + i].path, places[first + i].atom,
                          std::make_shared<const StatVector>(shrunk_change(experiment_.layout(), spread_, own,
                                                                           without_[series[i]], options_.map_share))};
    });
  }
  signatures_.insert(signatures_.end(), std::make_move_iterator(found.begin()), std::make_move_iterator(found.end()));
  std::sort(signatures_.begin(), signatures_.end(), [](const Signature& a, const Signature& b) {
    return std::tie(a.hypothesis, a.path, a.atom) < std::tie(b.hypothesis, b.path, b.atom);
  });
}

Ranking::Ranking(const Experiment& experiment, const Rung& rung, const Hypotheses& hypotheses,
                 const std::vector<Signature>& signatures)
    : hypotheses_(hypotheses), metric_(rung.train), rows_(signatures.size()) {
  parallel_for(static_cast<int>(signatures.size()), [&](int i) {
    const Signature& s = signatures[i];
    rows_[i] = {s.hypothesis, s.path, s.atom, {}, {}};
    // Nuisances first: what a pose makes up for is large, and squeezed it would look like something else.
    rows_[i].change = metric_.apply(rung.standard.difference(*s.change), rows_[i].nuisances);
    compress(rows_[i].change);
  });
  for (int i = 0; i < static_cast<int>(rows_.size()); ++i) {
    if (paths_.empty() || paths_.back().hypothesis != rows_[i].hypothesis || paths_.back().path != rows_[i].path)
      paths_.push_back({rows_[i].hypothesis, rows_[i].path, {}, {}});
    paths_.back().rows.push_back(i);
  }
  cross_.resize(paths_.size());
  for (std::size_t k = 0; k < paths_.size(); ++k) {
    auto& path = paths_[k];
    const int n = static_cast<int>(path.rows.size());
    path.gram.resize(n, n);
    for (int a = 0; a < n; ++a)
      for (int b = 0; b <= a; ++b)
        path.gram(a, b) = path.gram(b, a) = product(rows_[path.rows[a]], rows_[path.rows[b]]);
    const int of = hypotheses.tested[path.hypothesis].paths[path.path].quadrature_of;
    if (of < 0) continue;
    const auto& other = *std::find_if(paths_.begin(), paths_.end(), [&](const PathData& p) {
      return p.hypothesis == path.hypothesis && p.path == of;
    });
    cross_[k].resize(other.rows.size(), n);
    for (std::size_t a = 0; a < other.rows.size(); ++a)
      for (int b = 0; b < n; ++b)
        cross_[k](static_cast<int>(a), b) = product(rows_[other.rows[a]], rows_[path.rows[b]]);
  }
}

double Ranking::product(const Row& a, const Row& b) const {
  return dot(a.change, b.change) + metric_.prior_product(a.nuisances, b.nuisances);
}

std::vector<LinearGain> Ranking::gains(const Whitened& rest, const std::vector<double>& nuisances) const {
  std::vector<LinearGain> result(hypotheses_.tested.size());
  for (std::size_t h = 0; h < result.size(); ++h) {
    result[h].hypothesis = static_cast<int>(h);
    if (!hypotheses_.tested[h].paths.empty() && !hypotheses_.tested[h].paths[0].atoms.empty())
      result[h].values = hypotheses_.tested[h].paths[0].atoms[0].values;
  }
  std::vector<double> projection(rows_.size());
  parallel_for(static_cast<int>(rows_.size()), [&](int i) {
    projection[i] = dot(rows_[i].change, rest) + metric_.prior_product(rows_[i].nuisances, nuisances);
  });
  for (std::size_t k = 0; k < paths_.size(); ++k) {
    const auto& path = paths_[k];
    const Hypothesis& hypothesis = hypotheses_.tested[path.hypothesis];
    const StrengthPath& strengths = hypothesis.paths[path.path];
    LinearGain& best = result[path.hypothesis];
    const int n = static_cast<int>(path.rows.size());
    Eigen::VectorXd b(n);
    for (int a = 0; a < n; ++a) b[a] = projection[path.rows[a]];
    const std::string& amplitude = hypothesis.declaration->amplitude;

    if (strengths.quadrature_of >= 0) {
      // Both quarters of the period together: amplitude and phase from a plane of traces.
      const auto& other = *std::find_if(paths_.begin(), paths_.end(), [&](const PathData& p) {
        return p.hypothesis == path.hypothesis && p.path == strengths.quadrature_of;
      });
      for (int a = 0; a < n; ++a) {
        Eigen::Matrix2d gram;
        gram << other.gram(a, a), cross_[k](a, a), cross_[k](a, a), path.gram(a, a);
        gram.diagonal().array() += 1e-9;
        const Eigen::Vector2d bb(projection[other.rows[a]], b[a]);
        const Eigen::Vector2d x = gram.ldlt().solve(bb);
        const double gain = x.dot(bb);
        if (gain <= best.gain || !std::isfinite(gain)) continue;
        best.gain = gain;
        best.values = hypothesis.paths[strengths.quadrature_of].atoms[a].values;
        best.values[amplitude] *= std::min(3.0, x.norm());
        for (const auto& spec : hypothesis.declaration->parameters)
          if (spec.kind == ParameterKind::phase) best.values[spec.name] += std::atan2(x[1], x[0]);
      }
      continue;
    }
    for (int sign : {1, -1}) {
      if (sign < 0 && !strengths.mirror) continue;
      Eigen::VectorXd w;
      const double gain = best_on_path(path.gram, sign * b, strengths.interpolate, w);
      if (gain <= best.gain) continue;
      best.gain = gain;
      int strongest = 0;
      for (int a = 0; a < n; ++a)
        if (w[a] > 0.3) strongest = a;
      best.values = strengths.atoms[strongest].values;
      const auto* spec = hypothesis.declaration->parameter(amplitude);
      if (strengths.interpolate && spec->neutral && hypothesis.declaration->stronger_is_larger) {
        double value = 0;
        for (int a = 0; a < n; ++a) value += w[a] * (strengths.atoms[a].values.at(amplitude) - *spec->neutral);
        best.values[amplitude] = *spec->neutral + sign * value;
      }
    }
  }
  for (auto& gain : result)
    for (auto& [name, value] : gain.values) {
      const auto* spec = hypotheses_.tested[gain.hypothesis].declaration->parameter(name);
      if (!spec) continue;
      if (spec->kind == ParameterKind::phase) {
        const double two_pi = 6.28318530717958648;
        value = std::fmod(value - spec->lower, two_pi);
        value = spec->lower + (value < 0 ? value + two_pi : value);
      }
      value = std::clamp(value, spec->lower, spec->upper);
      if (spec->kind == ParameterKind::integer) value = std::round(value);
    }
  return result;
}

std::vector<LinearGain> gains_about(const Experiment& experiment, const Rung& rung, const Hypotheses& hypotheses,
                                    const SignatureOptions& options) {
  constexpr int at_once = 32;  // hypotheses: signatures of all periods take more memory than all else
  SignatureBook book(experiment, rung.model, hypotheses, options);
  std::vector<LinearGain> result;
  for (const int count = static_cast<int>(hypotheses.tested.size()); static_cast<int>(result.size()) < count;) {
    std::vector<int> some(std::min<std::size_t>(at_once, count - result.size()));
    std::iota(some.begin(), some.end(), static_cast<int>(result.size()));
    book.look_at(some, false);
    const auto gains = Ranking(experiment, rung, hypotheses, book.take()).gains(rung.rest, rung.nuisances);
    for (const int h : some) result.push_back(gains[h]);
  }
  return result;
}

PValue gain_p_value(double gain, std::vector<double> null_gains) {
  PValue result;
  const double n = static_cast<double>(null_gains.size());
  if (n < 4) return result;
  double mean = 0, square = 0, above = 0;
  for (double g : null_gains) {
    mean += g / n;
    square += g * g / n;
    above += g >= gain;
  }
  result.p = (above + 1) / (n + 1);
  if (above > 0) return result;
  // Beyond every null: the tail of an exponential that is as wide as the nulls are (a gain is a squared normal, whose
  // tail is exponential), begun at the largest null.
  const double largest = *std::max_element(null_gains.begin(), null_gains.end());
  const double width = std::max({2.0, std::sqrt(std::max(0.0, square - mean * mean)), mean});
  result.p *= std::exp(-(gain - largest) / (2 * width));
  result.p = std::max(result.p, 1e-12);
  result.extrapolated = result.p < 1 / (n + 1);
  return result;
}

}  // namespace binrig
