#include "diagnose/intervals.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>

#include "compare/probability.h"
#include "diagnose/how_often.h"
#include "diagnose/profile.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double chi_95 = 3.84;
const std::string says_nothing = "this recording says hardly anything about it";
const std::string unmoved = "nothing in this recording moves with it";
const std::string looks_the_same = "targets that stand elsewhere look the same, and nobody knows where they stand";

/// `value`, `half`: on the scale of the fit.
std::array<double, 2> interval_about(const FitParameter& parameter, double value, double half) {
  if (parameter.circular) return {parameter.natural(value) - half, parameter.natural(value) + half};
  return {parameter.natural(value - half), parameter.natural(value + half)};
}

class Intervals {
 public:
  /// `of`: instances whose intervals are looked for.
  Intervals(const LastFit& fit, const std::set<std::string>& of, SensorModel& model,
            std::vector<CalibratedParameter>& parameters)
      : experiment_(fit.experiment),
        layout_(experiment_.layout()),
        catalogue_(experiment_.forward().catalogue()),
        motions_(fit.motions),
        rung_(fit.rung),
        last_(fit.last),
        first_(fit.first),
        of_(of),
        poses_known_(fit.poses_known),
        seed_(fit.seed),
        model_(model),
        parameters_(parameters) {}

  void find(const std::vector<std::pair<std::string, const ParameterSpec*>>& steps) {
    report();
    count_chances();
    widen();
    bound_strengths();
    follow_ridges();
    choose_rough_strengths();
    for (const auto& [id, spec] : steps)
      if (!entry_of(id, spec->name).determined()) choose_step(id, *spec);
  }

  /// Of intervals that are there; and those of steps.
  void grow(const std::vector<std::pair<std::string, const ParameterSpec*>>& steps) {
    only_grow_ = true;
    widen();
    follow_ridges();
    choose_rough_strengths();
    for (const auto& [id, spec] : steps) choose_step(id, *spec);
  }

 private:
  CalibratedParameter& entry_of(const std::string& id, const std::string& name) const {
    return *std::find_if(parameters_.begin(), parameters_.end(),
                         [&](const CalibratedParameter& p) { return p.id == id && p.name == name; });
  }
  const EffectDeclaration& declaration_of(const std::string& id) const {
    return model_.find(id)->declaration(catalogue_);
  }

  /// What the last step's covariance says.
  void report() {
    const int n = static_cast<int>(first_.size());
    const Eigen::VectorXd half = last_.half_interval();
    for (int p = 0; p < n; ++p) {
      const FitParameter& parameter = first_[p];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const double sd = std::sqrt(std::max(0.0, last_.covariance(p, p)));
      entry.value = parameter.natural(last_.value[p]);
      entry.narrowing = std::min(1.0, sd / prior_deviation(parameter));
      if (silent(rung_.fit.slopes[p])) {
        entry.reason = unmoved;
      } else if (last_.information(p, p) == 0) {
        entry.reason = says_nothing;
      } else if (entry.narrowing >= narrow_enough) {
        int rival = -1;
        double closest = 0.9;
        for (int q = 0; q < n; ++q) {
          const double c =
              std::abs(last_.covariance(p, q)) / std::sqrt(last_.covariance(p, p) * last_.covariance(q, q));
          if (q != p && c > closest) closest = c, rival = q;
        }
        entry.reason =
            rival < 0 ? says_nothing : fmt::format("only together with {}.{}", first_[rival].id, first_[rival].name);
      } else if (!poses_known_ && share_beyond_places(layout_, last_, p) < 0.1) {
        entry.reason = looks_the_same;
      } else {
        entry.ci95 = interval_about(parameter, last_.value[p], half[p]);
      }
    }
  }

  bool is_chance(const FitParameter& parameter) const {
    return declaration_of(parameter.id).parameter(parameter.name)->kind == ParameterKind::chance;
  }

  /// How often something happens to whole frames is counted.
  void count_chances() {
    const int n = static_cast<int>(first_.size()), first_row = static_cast<int>(rung_.place.size()) - n;
    for (int p = 0; p < n; ++p) {
      const FitParameter& parameter = first_[p];
      if (!is_chance(parameter)) continue;
      const ParameterSpec& spec = *declaration_of(parameter.id).parameter(parameter.name);
      const HowOften often =
          count_occurrences(experiment_, rung_, model_, parameter.id, spec, first_row + p, seed_ + 4000);
      const auto [low, high] = often.interval(student_threshold(0.05, counted_recordings - 1));
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      entry.ci95.reset();
      entry.narrowing = often.scatter > 0 ? std::min(1.0, (high - low) / 4 / prior_deviation(parameter)) : 1;
      if (entry.narrowing >= narrow_enough) {
        if (entry.reason.empty()) entry.reason = says_nothing;
        continue;
      }
      entry.value = value_in(model_, entry.id, entry.name).value = often.value;
      entry.ci95 = {{std::clamp(low, spec.lower, spec.upper), std::clamp(high, spec.lower, spec.upper)}};
      entry.reason.clear();
    }
  }

  /// Thresholds and widths move pixel after pixel: between two of them nothing changes, and a slope taken over many
  /// says nothing of that. An interval reaches at least to where chi has risen by half of what its end stands for (by
  /// less than all, since the other parameters stay).
  void widen() {
    constexpr int doublings = 6;
    for (const FitParameter& parameter : first_) {
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      if (!of_.contains(entry.id) || !entry.determined() || parameter.circular || is_chance(parameter)) continue;
      const double at = parameter.scaled(entry.value), limit = 0.5 * chi_95 * rung_.dispersion;
      const double least = chi_with(entry.id, entry.name, entry.value);
      for (double& end : *entry.ci95) {
        double reach = parameter.scaled(end) - at;
        for (int k = 0; k < doublings && end > parameter.lower && end < parameter.upper; ++k, reach *= 2) {
          end = parameter.natural(at + reach);
          if (chi_with(entry.id, entry.name, end) > least + limit) break;
        }
      }
    }
  }

  /// Effects fade away long before their strength is nothing. There slopes say nothing, or how far a strength is above
  /// that, and not that nothing would do as well: values are tried, the other parameters following by their slopes.
  void bound_strengths() {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t p = 0; p < first_.size(); ++p) {
      const FitParameter& parameter = first_[p];
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const EffectDeclaration& declaration = declaration_of(entry.id);
      const ParameterSpec* spec = declaration.parameter(entry.name);
      if (entry.name != declaration.amplitude || !spec->neutral || entry.reason == unmoved ||
          entry.reason == looks_the_same || spec->kind == ParameterKind::chance)
        continue;  // what poses would cost in chi says nothing of it, nor what frames cost that others are copies of
      const double neutral = *spec->neutral, strong = spec->either_sign && entry.value < 0 ? -spec->typical_high
                                                      : neutral < spec->typical_low        ? spec->typical_high
                                                                                           : spec->typical_low;
      if (entry.determined() && (*entry.ci95)[0] < neutral && neutral < (*entry.ci95)[1]) continue;
      if (!std::isfinite(least)) least = refit(model_, -1).chi;
      const auto at = [&](double value) {
        SensorModel changed = model_;
        value_in(changed, entry.id, entry.name).value = value;
        Fit fit = refit(changed, static_cast<int>(p));
        if (tracing())
          fmt::print(stderr, "{}.{} = {:.4g}: chi + {:.1f}\n", entry.id, entry.name, value, fit.chi - least);
        return fit;
      };
      const double limit = least + chi_95 * rung_.dispersion;
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
      if (without.chi >= least + rung_.dispersion) continue;
      adopt(without);
      entry.value = neutral;
    }
  }

  /// A fit beside another value of a parameter is better than the one so far: the intervals of what was fitted go along,
  /// and grow by what two simulations scatter.
  void adopt(const Fit& fit) {
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
    model_ = fit.model;
  }

  /// The parameter that is most correlated with it among those determined, and how much. -1: there is none.
  std::pair<int, double> closest_partner(int p) const {
    std::pair<int, double> closest{-1, 0};
    const Eigen::MatrixXd& c = last_.covariance;
    for (int q = 0; q < static_cast<int>(first_.size()); ++q) {
      const double correlation = std::abs(c(p, q)) / std::sqrt(c(p, p) * c(q, q));
      if (q != p && entry_of(first_[q].id, first_[q].name).determined() && correlation > closest.second)
        closest = {q, correlation};
    }
    return closest;
  }

  /// Two parameters that make up for each other do so along a curve, and slopes see it straight. Where a strength has
  /// such a partner, the ends of its interval are moved out until they are ruled out, each fit of the others starting
  /// where the last one ended; what these become on the way belongs to their intervals. Where nothing rules it out
  /// before its prior does, the two are only known together.
  void follow_ridges() {
    constexpr double ridge = 0.8;  // correlation
    std::set<int> followed;
    for (int p = 0; p < static_cast<int>(first_.size()); ++p) {
      CalibratedParameter& entry = entry_of(first_[p].id, first_[p].name);
      if (!of_.contains(entry.id) || !entry.determined() || entry.name != declaration_of(entry.id).amplitude) continue;
      const auto& [low, high] = *entry.ci95;
      const auto neutral = declaration_of(entry.id).parameter(entry.name)->neutral;
      if (neutral && low <= *neutral && *neutral <= high) continue;
      const auto [partner, correlation] = closest_partner(p);
      if (tracing() && partner >= 0)
        fmt::print(stderr, "{}.{} goes with {}.{} by {:.2f}\n", entry.id, entry.name, first_[partner].id,
                   first_[partner].name, correlation);
      if (correlation < ridge || followed.contains(partner)) continue;
      follow_ridge(p, partner);
      followed.insert(p);
    }
  }

  void follow_ridge(int p, int partner) {
    constexpr double growth = 1.6;  // of the reach, from one value to the next
    const FitParameter& parameter = first_[p];
    CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
    CalibratedParameter& other = entry_of(first_[partner].id, first_[partner].name);
    Profile profile(experiment_, motions_, rung_, last_.metric, last_.place, true, seed_ + 500);
    const double at = parameter.scaled(entry.value), known = narrow_enough * prior_deviation(parameter);
    const auto ends = *entry.ci95;
    const double middle = entry.value;
    std::map<double, Fit> fits{{middle, refit(model_, p)}};
    profile.ask(middle, fits.at(middle).model);
    bool open = false;
    for (const double end : ends) {
      SensorModel from = fits.at(middle).model;
      int ruled_out = 0;
      for (double reach = parameter.scaled(end) - at;; reach *= growth) {
        open = open || std::abs(reach) > 4 * known;
        if (open) break;
        const double value = parameter.natural(at + reach);
        if (value <= parameter.lower || value >= parameter.upper) break;
        value_in(from, entry.id, entry.name).value = value;
        const Fit& fit = fits[value] = refit(from, p);
        from = fit.model;
        const double chi = profile.ask(value, from);
        if (tracing())
          fmt::print(stderr, "{}.{} = {:.4g}, {}.{} = {:.4g}: chi {:.1f}, may rise by {:.1f}\n", entry.id, entry.name,
                     value, other.id, other.name, from.find(other.id)->value(other.name), chi, profile.limit());
        ruled_out = profile.holds(value) ? 0 : ruled_out + 1;
        if (ruled_out == 2) break;  // one alone may be a rough place
      }
    }
    if (!profile.holds(middle)) {
      adopt(fits.at(profile.best()));
      entry.value = profile.best();
    }
    const auto reach_to = [](CalibratedParameter& which, double value) {
      auto& [low, high] = *which.ci95;
      low = std::min(low, value), high = std::max(high, value);
    };
    for (const auto& [value, fit] : fits) {
      if (!profile.holds(value)) continue;
      reach_to(entry, value);
      for (std::size_t q = 0; q < fit.parameters.size(); ++q) {
        const FitParameter& follower = fit.parameters[q];
        if (!follower.circular)
          reach_to(entry_of(follower.id, follower.name), follower.natural(fit.value[static_cast<int>(q)]));
      }
    }
    entry.narrowing =
        (parameter.scaled((*entry.ci95)[1]) - parameter.scaled((*entry.ci95)[0])) / 4 / prior_deviation(parameter);
    if (only_grow_ || (!open && entry.narrowing < narrow_enough)) return;
    for (const auto& [left_open, why] : {std::pair{&entry, &other}, std::pair{&other, &entry}}) {
      left_open->ci95.reset();
      left_open->narrowing = 1;
      left_open->reason = fmt::format("only together with {}.{}", why->id, why->name);
    }
  }

  /// All parameters that are determined, but one, fitted again to all frames.
  Fit refit(const SensorModel& model, int without) const {
    std::vector<FitParameter> parameters;
    Fit nearby;
    for (std::size_t p = 0; p < first_.size(); ++p) {
      if (static_cast<int>(p) == without || !entry_of(first_[p].id, first_[p].name).determined()) continue;
      parameters.push_back(first_[p]);
      nearby.slopes.push_back(rung_.fit.slopes[p]);
      nearby.seed_slopes.push_back(rung_.fit.seed_slopes[p]);
    }
    FitOptions options = quick();
    options.nearby = &nearby;
    options.iterations = 0;
    return fit_model(experiment_, rung_.standard, last_.metric, rung_.data, model, parameters, rung_.offsets, options);
  }

  FitOptions quick() const {
    FitOptions options;
    options.seed = seed_ + 500;
    options.place = last_.place;
    return options;
  }

  double chi_with(const std::string& id, const std::string& name, double value) const {
    SensorModel changed = model_;
    value_in(changed, id, name).value = value;
    return fit_model(experiment_, rung_.standard, last_.metric, rung_.data, changed, {}, rung_.offsets, quick()).chi;
  }

  /// The best value tried, and where it lies for certain.
  void take(const Profile& profile, const std::string& id, const ParameterSpec& spec) {
    CalibratedParameter& entry = entry_of(id, spec.name);
    const auto found = certain(profile, spec);
    if (!found && only_grow_ && entry.determined()) {
      auto& [low, high] = *entry.ci95;
      low = std::min(low, spec.typical_low), high = std::max(high, spec.typical_high);
      return;
    }
    entry.ci95 = found;
    if (!entry.ci95) {
      entry.reason = says_nothing;
      return;
    }
    value_in(model_, id, spec.name).value = entry.value = profile.best();
    const auto [low, high] = *entry.ci95;
    entry.narrowing = std::min(1.0, (high - low) / std::max(std::abs(spec.typical_high - spec.typical_low), 1e-12));
  }

  /// No slope leads to whole numbers and steps: their values are tried. A whole number may be made up for by others,
  /// which follow it by their slopes; a step is told by itself.
  void choose_step(const std::string& id, const ParameterSpec& spec) {
    Profile profile(experiment_, motions_, rung_, last_.metric, last_.place, false, seed_ + 500);
    std::map<double, Fit> fits;
    const auto follow = [&](const SensorModel& changed) {
      return fits.insert_or_assign(changed.find(id)->value(spec.name), refit(changed, -1)).first->second.model;
    };
    const bool whole = spec.kind == ParameterKind::integer;
    explore_steps(profile, model_, id, spec, whole ? Follow(follow) : Follow());
    const double before = model_.find(id)->value(spec.name);
    take(profile, id, spec);
    const CalibratedParameter& entry = entry_of(id, spec.name);
    if (whole && entry.determined() && entry.value != before) adopt(fits.at(entry.value));
  }

  /// What shows the scene from elsewhere moves edges pixel after pixel: chi is rough along its strength, and slopes end
  /// in one of many valleys and promise too much there.
  void choose_rough_strengths() {
    for (const FitParameter& parameter : first_) {
      CalibratedParameter& entry = entry_of(parameter.id, parameter.name);
      const EffectDeclaration& declaration = declaration_of(entry.id);
      if (!of_.contains(entry.id) || !entry.determined()) continue;
      const ParameterSpec& spec = *declaration.parameter(entry.name);
      const bool strength = entry.name == declaration.amplitude, mask = declaration.stage == Stage::signal_mask;
      const bool rough = (strength && (declaration.may_clear || mask)) || (mask && spec.log_scaled);
      if (!rough || spec.kind == ParameterKind::chance) continue;
      Profile profile(experiment_, motions_, rung_, last_.metric, last_.place, true, seed_ + 500);
      const double deviation = (parameter.scaled((*entry.ci95)[1]) - parameter.scaled((*entry.ci95)[0])) / 4;
      explore(profile, model_, entry.id, spec, deviation, {0.5, 1, 2, 4});
      take(profile, entry.id, spec);
      // Where nothing is ruled out, the user's value is as good as where slopes led.
      if (!entry.determined()) entry.value = value_in(model_, entry.id, entry.name).value = entry.before;
    }
  }

  const Experiment& experiment_;
  const Layout& layout_;
  const EffectCatalogue& catalogue_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const LastStep& last_;
  const std::vector<FitParameter>& first_;
  const std::set<std::string>& of_;
  const bool poses_known_;
  const std::uint64_t seed_;
  SensorModel& model_;
  std::vector<CalibratedParameter>& parameters_;
  bool only_grow_ = false;
};

}  // namespace

void find_intervals(const LastFit& fit, const std::vector<std::pair<std::string, const ParameterSpec*>>& steps,
                    SensorModel& model, std::vector<CalibratedParameter>& parameters) {
  std::set<std::string> all;
  for (const FitParameter& parameter : fit.first) all.insert(parameter.id);
  Intervals(fit, all, model, parameters).find(steps);
}

std::vector<CalibratedParameter> widened_intervals(const LastFit& fit, const std::set<std::string>& of,
                                                   SensorModel& model) {
  const Eigen::VectorXd half = fit.last.half_interval();
  std::vector<CalibratedParameter> entries;
  for (std::size_t k = 0; k < fit.first.size(); ++k) {
    const FitParameter& parameter = fit.first[k];
    const int p = static_cast<int>(k);
    CalibratedParameter& entry = entries.emplace_back(parameter.id, parameter.name, parameter.unit);
    entry.before = entry.value = parameter.natural(fit.last.value[p]);
    entry.ci95 = interval_about(parameter, fit.last.value[p], half[p]);
  }
  std::vector<std::pair<std::string, const ParameterSpec*>> steps;
  const EffectCatalogue& catalogue = fit.experiment.forward().catalogue();
  for (const EffectInstance& instance : model.effects) {
    if (!of.contains(instance.id)) continue;
    for (const ParameterSpec& spec : instance.declaration(catalogue).parameters) {
      const bool fitted = std::ranges::any_of(
          fit.first, [&](const FitParameter& p) { return p.id == instance.id && p.name == spec.name; });
      const ParameterValue& value = instance.values.at(spec.name);
      if (fitted || value.ci95 || (spec.kind != ParameterKind::integer && spec.interpolate)) continue;
      steps.emplace_back(instance.id, &spec);
      CalibratedParameter& entry = entries.emplace_back(instance.id, spec.name, spec.unit);
      entry.before = entry.value = value.value;
    }
  }
  Intervals(fit, of, model, entries).grow(steps);
  std::erase_if(entries, [&](const CalibratedParameter& entry) { return !of.contains(entry.id); });
  return entries;
}

}  // namespace binrig
