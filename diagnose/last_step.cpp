#include "diagnose/last_step.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "compare/probability.h"
#include "core/error.h"
#include "core/parallel.h"
#include "diagnose/slopes.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double straight = 0.25;     // of the prior's standard deviation: over so much of it, slopes hold
constexpr int seeds = 3;              // of derivatives
constexpr double far_enough = 4;      // of FitParameter::step, for narrow parameters: beyond what rounding does
constexpr double least_signal = 0.3;  // share of a derivative's square that must be more than its own noise
constexpr double most_wrong = 0.5;    // of a block's y over a standard deviation of a parameter, by its slope
constexpr double well_within = 0.4;   // of that distance: over half of it a spectrum bends too much, by a hair
constexpr double smooth_bend = 0.5;   // of a slope to both sides, that to one may differ by: it is a curve's, still
constexpr double most_of_it = 0.5;  // of what is known of a parameter alone, which blocks that are left out do not hold

class Step {
 public:
  Step(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
       const std::vector<FitParameter>& priors, bool series, std::uint64_t seed)
      : experiment_(experiment),
        layout_(experiment.layout()),
        motions_(motions),
        rung_(rung),
        priors_(priors),
        series_(series),
        seed_(seed) {}

  /// One more step, against the mean of the model's own simulations, and the covariance of that very step.
  LastStep run() {
    const int n = static_cast<int>(priors_.size());
    result_.model = rung_.model;
    result_.value = rung_.fit.value.head(n);  // narrow ones come after
    result_.place.assign(rung_.place.begin(), rung_.place.begin() + static_cast<long>(motions_.size()));
    result_.rows = motion_rows(layout_, rung_.standard, motions_);
    result_.metric = Metric(layout_, Part::train, result_.rows);
    const Whitened rest = result_.metric.explain(rung_.data, result_.place).rest;
    if (n == 0) return std::move(result_);
    precision_.resize(n);
    VectorXd pull(n);
    for (int p = 0; p < n; ++p) {
      precision_[p] = priors_[p].circular ? 0.01 : 1 / std::pow(priors_[p].prior_sigma, 2);
      pull[p] = priors_[p].circular ? 0 : -precision_[p] * (result_.value[p] - priors_[p].prior_centre);
    }
    differentiate(Pull(rest));
    const MatrixXd gradients = null_gradients();
    const auto count = static_cast<double>(gradients.rows());
    // Compression moves the mean of what is skewed: of the recording as of the simulations.
    const VectorXd bias = gradients.colwise().mean().transpose();
    const MatrixXd centred = gradients.rowwise() - bias.transpose();
    MatrixXd scatter = rung_.dispersion * (1 + 1.0 / count) * (centred.transpose() * centred) / (count - 1.0);
    scatter += rung_.dispersion * scatter_from_floors();
    scatter.diagonal() += precision_;
    MatrixXd a = result_.information;
    a.diagonal() += precision_;
    const MatrixXd inverse = a.partialPivLu().inverse();
    result_.covariance = inverse * scatter * inverse.transpose();
    result_.freedom = count - 1;

    std::vector<bool> stays(n, false);
    for (int p = 0; p < n; ++p) {
      // A parameter of which the recording knows little is led by the noise of its slope, and where there is one, over
      // more than a straight line's length. It stays where two simulations put it.
      stays[p] = std::sqrt(result_.covariance(p, p)) > straight * prior_deviation(priors_[p]);
      if (stays[p]) result_.covariance.row(p) *= std::sqrt(1.5), result_.covariance.col(p) *= std::sqrt(1.5);
    }
    const VectorXd step = result_.step =
        bounded_solution(a, gradient(rest, result_.jacobian, freed_) - bias + pull, stays);
    result_.value += step;
    result_.length = std::sqrt(std::max(0.0, step.dot(result_.covariance.ldlt().solve(step))));
    if (tracing()) fmt::print(stderr, "last step of length {:.2f}\n", result_.length);
    // Over a step that chance does not make so long, slopes do not hold: the truth may be anywhere along it.
    if (step.squaredNorm() > 0 && result_.length * result_.length > n + 3 * std::sqrt(2.0 * n))
      result_.covariance += step * step.transpose();
    for (int p = 0; p < n; ++p) {
      if (tracing())
        fmt::print(stderr, "last step {}.{}: {:.5g} by {:.5g}, standard deviation {:.5g}\n", priors_[p].id,
                   priors_[p].name, result_.value[p], step[p], std::sqrt(result_.covariance(p, p)));
    }
    result_.model = stepped(result_, priors_, 1);
    return std::move(result_);
  }

 private:
  /// Half of what chi falls by along each parameter.
  static VectorXd gradient(const Whitened& residual, const std::vector<Whitened>& jacobian,
                           const std::vector<Whitened>& freed) {
    const Pull pull(residual);
    VectorXd g(jacobian.size());
    for (std::size_t p = 0; p < jacobian.size(); ++p)
      g[static_cast<int>(p)] = pull.along(pull.direct(), jacobian[p], freed[p]);
    return g;
  }

  /// Gradients of the nulls, one a row, as the recording would have them. Each with derivatives whitened as it is:
  /// those whitened by what it helped to teach go where it happens to scatter little.
  MatrixXd null_gradients() const {
    const int n = static_cast<int>(priors_.size()), count = static_cast<int>(rung_.nulls.size()),
              folds = static_cast<int>(rung_.others.size());
    const auto information = [&](const std::vector<Whitened>& jacobian, const std::vector<Whitened>& freed) {
      MatrixXd a = precision_.asDiagonal();
      for (int p = 0; p < n; ++p)
        for (int q = 0; q < n; ++q) a(p, q) += dot(jacobian[p], freed[q]);
      return a;
    };
    const MatrixXd own = information(result_.jacobian, freed_);
    MatrixXd gradients(count, n);
    parallel_for(folds, [&](int fold) {
      const Standard& standard = rung_.others[fold];
      const Metric metric(layout_, Part::train, motion_rows(layout_, standard, motions_));
      std::vector<Whitened> jacobian(n, Whitened(layout_.size, 0.f)), freed = jacobian;
      for (int p = 0; p < n; ++p) {
        if (silent(result_.jacobian[p])) continue;
        Whitened whole = standard.difference(changes_[p]);
        pool(layout_, standard.spread(), pooled_[p], whole);
        for (std::size_t b = 0; b < layout_.blocks.size(); ++b)
          if (const Block& block = layout_.blocks[b]; keeps(p, b))
            std::copy_n(whole.begin() + block.offset, block.size, jacobian[p].begin() + block.offset);
        freed[p] = metric.apply(jacobian[p]);
      }
      const MatrixXd to_own = own * information(jacobian, freed).ldlt().solve(MatrixXd::Identity(n, n));
      for (int k = fold; k < count; k += folds)
        gradients.row(k) = (to_own * gradient(metric.explain(rung_.nulls[k]).rest, jacobian, freed)).transpose();
    });
    return gradients;
  }

  /// What does not scatter among simulations (a mask that moves pixel after pixel) is only as good as its practical
  /// floor: between two pixels nothing changes, and slopes see a ramp.
  MatrixXd scatter_from_floors() const {
    constexpr double still = 0.05;  // of the variance that a null has where its floor is nothing
    const int n = static_cast<int>(priors_.size());
    std::vector<float> square(layout_.size, 0.f);
    for (const Whitened& null : rung_.nulls)
      for (int i = 0; i < layout_.size; ++i) square[i] += null[i] * null[i] / static_cast<float>(rung_.nulls.size());
    MatrixXd scatter = MatrixXd::Zero(n, n);
    for (int i = 0; i < layout_.size; ++i) {
      if (square[i] > still) continue;
      for (int p = 0; p < n; ++p)
        for (int q = 0; q < n; ++q) scatter(p, q) += static_cast<double>(freed_[p][i]) * freed_[q][i];
    }
    return scatter;
  }

  Trial trial(const SensorModel& model, int k) const {
    return {model, rung_.offsets, seed_ + 700 + static_cast<std::uint64_t>(k), Part::train, short_frames, !series_};
  }

  /// Does parameter p's derivative count in a block (index in the layout)?
  bool keeps(int p, std::size_t block) const { return counts_[block] && kept_[p][layout_.blocks[block].segment]; }

  /// Unbiased square of what vectors of several seeds have in common in a block.
  static double common_square(const Block& block, const std::vector<Whitened>& by_seed) {
    double of_sum = 0, own = 0;
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      double sum = 0;
      for (const Whitened& one : by_seed) sum += one[i], own += static_cast<double>(one[i]) * one[i];
      of_sum += sum * sum;
    }
    const auto n = static_cast<double>(by_seed.size());
    return (of_sum - own) / (n * (n - 1));
  }

  /// Derivatives of y by the parameters, and what follows from them.
  void differentiate(const Pull& pull) {
    const int n = static_cast<int>(priors_.size());
    changes_.resize(n);
    kept_.resize(n);
    pooled_.resize(n);
    each_.resize(n);
    reach_.resize(n);
    error_ = MatrixXd::Zero(n, static_cast<int>(layout_.blocks.size()));
    smooth_.resize(n, error_.cols());
    std::vector<int> asked;
    for (int p = 0; p < n; ++p) {
      const FitParameter& parameter = priors_[p];
      reach_[p] = parameter.narrow ? far_enough * parameter.step : parameter.step;
      if (!silent(rung_.fit.slopes[p])) asked.push_back(p);
    }
    for (int k = 0; k < seeds; ++k) here_.push_back(trial(rung_.model, k));
    take_derivatives(asked);
    counts_.assign(layout_.blocks.size(), true);
    weigh(pull);
    leave_out_wrong(pull);
  }

  /// Derivatives by some parameters over their reach, one a seed, in captures cut short; and how wrong they are.
  void take_derivatives(const std::vector<int>& asked) {
    std::vector<Trial> trials;
    const auto add = [&](const FitParameter& parameter, double value) {
      SensorModel moved = rung_.model;
      value_in(moved, parameter.id, parameter.name).value = parameter.natural(value);
      for (int k = 0; k < seeds; ++k) trials.push_back(trial(moved, k));
      return parameter.circular ? value : parameter.scaled(parameter.natural(value));
    };
    std::vector<std::array<float, 2>> taken;  // ahead, and behind
    for (const int p : asked) {
      // To both sides: parameters that make up for each other to first order would seem to differ by the second.
      const double ahead = add(priors_[p], result_.value[p] + reach_[p]),
                   behind = add(priors_[p], result_.value[p] - reach_[p]);
      taken.push_back({static_cast<float>(ahead - result_.value[p]), static_cast<float>(result_.value[p] - behind)});
    }
    trials.insert(trials.end(), here_.begin(), here_.end());
    const auto simulated = experiment_.simulate(trials, "taking derivatives");
    const auto here = simulated.end() - seeds;
    parallel_for(static_cast<int>(asked.size()), [&](int m) {
      const int p = asked[m];
      const auto ahead = simulated.begin() + 2 * m * seeds, behind = ahead + seeds;
      const auto [up, down] = taken[m];
      std::vector<StatVector> changes(ahead, behind), bends(ahead, behind);
      for (int k = 0; k < seeds; ++k)
        for (int i = 0; i < layout_.size; ++i) {
          changes[k][i] = (ahead[k][i] - behind[k][i]) / (up + down);
          // Half of what the slopes to the two sides differ by; at a bound there is but one.
          bends[k][i] =
              up <= 0 || down <= 0 ? 0 : 0.5f * ((ahead[k][i] - here[k][i]) / up - (here[k][i] - behind[k][i]) / down);
        }
      fill_unknown(layout_, changes, true);
      fill_unknown(layout_, bends, true);
      changes_[p].assign(layout_.size, 0.f);
      for (const StatVector& change : changes)
        for (int i = 0; i < layout_.size; ++i) changes_[p][i] += change[i] / seeds;
      std::vector<Whitened> sides;
      each_[p].clear();
      for (const StatVector& change : changes) each_[p].push_back(rung_.standard.difference(change));
      for (const StatVector& bent : bends) sides.push_back(rung_.standard.difference(bent));
      pooled_[p] = pool_noisy(layout_, rung_.standard.spread(), least_signal, each_[p]);
      // Segments in which a derivative is mostly noise are left out.
      kept_[p].clear();
      for (const double signal : mean_over_seeds(layout_, each_[p]).signal) kept_[p].push_back(signal > least_signal);
      for (Whitened& one : sides) {
        pool(layout_, rung_.standard.spread(), pooled_[p], one);
        one = result_.metric.apply(one);
      }
      error_.row(p).setZero();
      smooth_.row(p).setConstant(false);
      for (std::size_t k = 0; k < layout_.blocks.size(); ++k) {
        if (!kept_[p][layout_.blocks[k].segment]) continue;
        // Where the slope to one side is larger than that to both by a share x, that to both is wrong by about a share
        // x^2 on a smooth curve; where x is 1, it is no slope. All of these are squares.
        const double b = common_square(layout_.blocks[k], sides), s = common_square(layout_.blocks[k], each_[p]);
        if (b > 0) error_(p, static_cast<int>(k)) = s > b ? b * b / s : b;
        smooth_(p, static_cast<int>(k)) = b < smooth_bend * smooth_bend * s;
      }
    });
  }

  /// Information and jacobian from derivatives by parameter and seed, of the blocks that count.
  void weigh(const Pull& pull) {
    const int n = static_cast<int>(each_.size());
    result_.jacobian.assign(n, Whitened(layout_.size, 0.f));
    freed_ = result_.jacobian;
    SeedSlopes freed(n), curved(n);
    parallel_for(n, [&](int p) {
      if (each_[p].empty()) return;
      auto counted = each_[p];
      for (std::size_t k = 0; k < layout_.blocks.size(); ++k)
        if (const Block& block = layout_.blocks[k]; !keeps(p, k))
          for (Whitened& d : counted) std::fill_n(d.begin() + block.offset, block.size, 0.f);
      result_.jacobian[p] = mean_over_seeds(layout_, counted).mean;
      freed_[p] = result_.metric.apply(result_.jacobian[p]);
      for (const Whitened& d : counted) {
        freed[p].push_back(result_.metric.apply(d));
        curved[p].push_back(pull.curved(d, freed[p].back()));
      }
    });
    result_.information = unbiased_products(curved, freed);
    MatrixXd together = products_of_means(curved, freed);
    for (int p = 0; p < n; ++p)
      if (result_.information(p, p) <= least_signal * together(p, p)) {
        result_.information.row(p).setZero(), result_.information.col(p).setZero();
        together.row(p).setZero(), together.col(p).setZero();
        std::fill(result_.jacobian[p].begin(), result_.jacobian[p].end(), 0.f);
        std::fill(freed_[p].begin(), freed_[p].end(), 0.f);
      }
    VectorXd scale(n);
    for (int p = 0; p < n; ++p) scale[p] = prior_deviation(priors_[p]);
    result_.information = positive_products(result_.information, together, scale);
  }

  /// Standard deviation that the information and what is known beforehand promise.
  double promised(int p) const {
    MatrixXd a = result_.information;
    a.diagonal() += precision_;
    return std::sqrt(a.ldlt().solve(VectorXd::Unit(a.rows(), p))[p]);
  }
  bool hardly_known(int p, double deviation) const { return deviation > straight * prior_deviation(priors_[p]); }

  /// Parameters that make up for each other leave little of their slopes together: where these are not right, what is
  /// left passes for knowing one from the other (lines of a histogram smeared by a drift come and go with it). Blocks
  /// in which that matters count no more, for no parameter, or the others would do what that one should. Over what
  /// distance it may matter, those blocks alone may say that are right over it: one that is wrong promises too small a
  /// one, over which it seems right. Where that distance is shorter than the derivatives' reach, these are taken over
  /// it once more: a spectrum that bends over a quarter of a pixel is straight over what all else leaves open. Lines
  /// that come and go are not, however short a piece of them is looked at. But where the parameter is hardly known
  /// without them (a blur of less than a pixel bends wherever it shows), or another effect loses most of what it is
  /// known by, all stay.
  void leave_out_wrong(const Pull& pull) {
    for (int p = 0; p < static_cast<int>(each_.size()); ++p) {
      // A mask's slopes are ramps over stairs: they differ from side to side wherever they are taken.
      if (rung_.model.find(priors_[p].id)->declaration(experiment_.forward().catalogue()).reason) continue;
      if (hardly_known(p, promised(p))) continue;
      const auto before = counts_;
      const VectorXd known = result_.information.diagonal();
      const double deviation = keep_right(pull, p, before, straight * prior_deviation(priors_[p]));
      if (counts_ != before && deviation < reach_[p]) {
        auto smooth = before;
        for (std::size_t k = 0; k < smooth.size(); ++k)
          if (!counts_[k] && !smooth_(p, static_cast<int>(k))) smooth[k] = false;
        reach_[p] = well_within * deviation;
        take_derivatives({p});
        weigh(pull);
        keep_right(pull, p, smooth, deviation);
      }
      if (counts_ == before) continue;
      bool lost = hardly_known(p, promised(p));
      for (int q = 0; q < known.size(); ++q)
        lost = lost || (priors_[q].id != priors_[p].id && result_.information(q, q) < most_of_it * known[q]);
      if (tracing())
        fmt::print(stderr, "slopes over {}.{} are wrong in {} blocks, {}\n", priors_[p].id, priors_[p].name,
                   std::ranges::count(before, true) - std::ranges::count(counts_, true),
                   lost ? "but little else is known" : "which are left out");
      if (!lost) continue;
      counts_ = before;
      weigh(pull);
    }
  }

  /// Of the blocks `before`, those count in which parameter p's slope is right over `deviation`, or over what they
  /// promise themselves if that is less. That distance.
  double keep_right(const Pull& pull, int p, const std::vector<bool>& before, double deviation) {
    for (double last = 2 * deviation; deviation < last; deviation = std::min(deviation, promised(p))) {
      last = deviation;
      auto right = before;
      for (int k = 0; k < error_.cols(); ++k)
        if (error_(p, k) * deviation * deviation > most_wrong * most_wrong) right[k] = false;
      if (right == counts_) continue;
      counts_ = right;
      weigh(pull);
    }
    return deviation;
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
        const FitParameter& parameter = priors_[free[i]];
        double reached = std::clamp(solved[i], -parameter.longest, parameter.longest);
        if (!parameter.circular)
          reached = parameter.scaled(parameter.natural(result_.value[free[i]] + reached)) - result_.value[free[i]];
        delta[free[i]] = reached;
        (std::abs(reached - solved[i]) > 1e-9 + 0.01 * std::abs(solved[i]) ? stopped : left).push_back(free[i]);
      }
      if (left.size() == free.size()) break;
      free = left;
    }
    return delta;
  }

  const Experiment& experiment_;
  const Layout& layout_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const std::vector<FitParameter>& priors_;
  const bool series_;
  const std::uint64_t seed_;
  VectorXd precision_;                     // of what is known beforehand
  SeedSlopes each_;                        // derivatives by parameter and seed
  std::vector<double> reach_;              // of derivatives to each side
  MatrixXd error_;                         // of slopes, squared, by parameter and block
  Eigen::ArrayXX<bool> smooth_;            // by the same: what bends there is a curve
  std::vector<Trial> here_;                // where derivatives are taken
  std::vector<Whitened> freed_;            // the jacobian, nuisances taken out
  std::vector<StatVector> changes_;        // the jacobian in the statistics' own units, mean over the seeds
  std::vector<std::vector<bool>> kept_;    // by parameter: segments of it that are not mostly noise
  std::vector<bool> counts_;               // by block: derivatives are right enough
  std::vector<std::vector<bool>> pooled_;  // by parameter: segments of it of which the maps' means are taken
  LastStep result_;
};

}  // namespace

double prior_deviation(const FitParameter& parameter) {
  return parameter.circular ? std::numbers::pi / std::sqrt(3.0) : parameter.prior_sigma;
}

bool silent(const Whitened& slope) {
  return std::all_of(slope.begin(), slope.end(), [](float v) { return v == 0; });
}

Eigen::VectorXd LastStep::half_interval() const {
  return student_threshold(0.05, freedom) * covariance.diagonal().cwiseMax(0).cwiseSqrt();
}

SensorModel stepped(const LastStep& step, const std::vector<FitParameter>& priors, double share) {
  SensorModel model = step.model;
  for (std::size_t p = 0; p < priors.size(); ++p) {
    const int i = static_cast<int>(p);
    value_in(model, priors[p].id, priors[p].name).value = priors[p].natural(step.value[i] - (1 - share) * step.step[i]);
  }
  return model;
}

LastStep last_step(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                   const std::vector<FitParameter>& priors, bool series, std::uint64_t seed) {
  return Step(experiment, motions, rung, priors, series, seed).run();
}

double share_beyond_places(const Layout& layout, const LastStep& step, int p) {
  std::vector<NuisanceRow> free = step.rows;
  for (auto& row : free)
    for (float& v : row.change) v *= 50;  // of the prior's sigmas: as good as no prior
  const Whitened& slope = step.jacobian[p];
  const double known = dot(step.metric.apply(slope), slope);
  const double left = dot(Metric(layout, Part::train, free).apply(slope), slope);
  // What a motion does is known to some hundredths, and where nobody knows it, a tenth of a trace is nobody's.
  return known > 0 && left > 1e-2 * dot(slope, slope) ? left / known : 0;
}

}  // namespace binrig
