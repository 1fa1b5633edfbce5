// Which strength and which texture a unit's map has (diagnose/unit_map.h).
#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "diagnose/trace.h"
#include "diagnose/unit_map.h"

namespace binrig {
namespace {

constexpr int places = 5;  // over a typical range
constexpr int few = UnitMap::few_units;  // to seek with,
constexpr int many = 16;                 // and to judge by whether a map is one of theirs

/// Units of a rung's model with a hypothesis.
class Units {
 public:
  Units(const Experiment& experiment, const Rung& rung, const Hypothesis& hypothesis)
      : experiment_(experiment), rung_(rung), hypothesis_(hypothesis) {}

  std::vector<StatVector> without(std::uint64_t seed, int frames = 2, int count = few) const {
    return simulate(rung_.model, seed, frames, count);
  }
  std::vector<StatVector> with(const std::map<std::string, double>& values, std::uint64_t seed, int frames = 2,
                               int count = few) const {
    return simulate(with_effect(rung_.model, experiment_.forward().catalogue(), hypothesis_.effect, values), seed,
                    frames, count);
  }
  std::vector<Whitened> changes(const std::map<std::string, double>& values, std::uint64_t seed, int frames = 2) const {
    return UnitMap::changes(rung_, without(seed, frames), with(values, seed, frames));
  }

 private:
  std::vector<StatVector> simulate(const SensorModel& model, std::uint64_t seed, int frames, int count) const {
    return experiment_.simulate(UnitMap::trials_of(rung_, model, seed, frames, count), "simulating units");
  }

  const Experiment& experiment_;
  const Rung& rung_;
  const Hypothesis& hypothesis_;
};

class MapFitter {
 public:
  MapFitter(const Experiment& experiment, const Rung& rung, const Hypothesis& hypothesis,
            const std::map<std::string, double>& values, UnitMap start, const std::vector<StatVector>& without,
            std::uint64_t seed)
      : layout_(experiment.layout()),
        rung_(rung),
        hypothesis_(hypothesis),
        units_(experiment, rung, hypothesis),
        without_(without),
        seed_(seed),
        fit_{values, std::move(start), {}} {}

  UnitMapFit run() {
    const auto segment = fit_.map.strongest(rung_.rest);
    const ParameterSpec* amplitude = hypothesis_.declaration->parameter(hypothesis_.declaration->amplitude);
    if (!segment || !amplitude) return std::move(fit_);
    segment_ = *segment;
    modes_ = fit_.map.modes(segment_);
    std::vector<std::string> names;
    std::vector<std::vector<double>> slopes;  // of log(expected power), by parameter and ring
    for (const ParameterSpec& spec : hypothesis_.declaration->parameters)
      if (&spec != amplitude && spec.kind == ParameterKind::continuous && !spec.either_sign && spec.typical_low > 0) {
        slopes.push_back(seek(spec));
        names.push_back(spec.name);
      }
    const Try found = solve_for_strength(*amplitude);
    slopes.push_back(found.match.slope);
    for (double& slope : slopes.back()) slope *= exponent_;
    names.push_back(amplitude->name);
    UnitMap at_found(layout_, rung_, units_.without(seed_, 0, many), units_.with(fit_.values, seed_, 0, many));
    fit_.information = {std::exchange(fit_.map, std::move(at_found)),
                        segment_,
                        std::move(names),
                        std::move(slopes),
                        found.units.kurtosis,
                        found.match.slope};
    return std::move(fit_);
  }

 private:
  struct Try {
    UnitMap::Spectrum units;
    UnitMap::Match match;
  };
  Try try_at(const std::map<std::string, double>& values) const {
    return matched(UnitMap::changes(rung_, without_, units_.with(values, seed_)));
  }
  /// With all frames, which the measured statistics are of.
  Try try_whole(const std::map<std::string, double>& values) const { return matched(units_.changes(values, seed_, 0)); }
  Try matched(const std::vector<Whitened>& changes) const {
    Try result;
    result.units = fit_.map.spectrum_of_units(segment_, changes);
    result.match = fit_.map.match(segment_, rung_.rest, result.units);
    return result;
  }

  /// Finds a parameter's most likely value, whatever the strength: the typical range, then halfway to either side until
  /// those beside the best are hardly less likely, then the parabola through three. Returns how the logarithm of the
  /// expected power changes with the parameter's.
  std::vector<double> seek(const ParameterSpec& spec) {
    constexpr double hardly = 4.5;  // of a log-likelihood: three deviations, where a parabola still follows it
    constexpr int coarsest = 16;    // of finest steps
    const double finest = std::log(spec.typical_high / spec.typical_low) / ((places - 1) * coarsest);
    std::map<int, Try> tried;  // by finest steps from the low end
    const auto value_at = [&](double steps) {
      return std::clamp(spec.typical_low * std::exp(steps * finest), spec.lower, spec.upper);
    };
    const auto likely = [&](int k) {
      if (!tried.count(k)) {
        auto values = fit_.values;
        values[spec.name] = value_at(k);
        tried[k] = try_at(values);
      }
      return tried[k].match.log_likelihood;
    };
    int best = 0;
    const auto look_at = [&](int k) {
      if (likely(k) > likely(best)) best = k;
    };
    for (int place = 0; place < places; ++place) look_at(place * coarsest);
    int step = coarsest;
    do {
      step /= 2;
      for (int middle = -1; middle != best;) {
        middle = best;
        look_at(middle - step);
        look_at(middle + step);
      }
    } while (step > 1 && likely(best) - std::min(likely(best - step), likely(best + step)) > hardly);
    const Try &low = tried[best - step], &here = tried[best], &high = tried[best + step];
    const double below = low.match.log_likelihood, above = high.match.log_likelihood;
    const double bend = below - 2 * here.match.log_likelihood + above;
    fit_.values[spec.name] =
        value_at(bend < 0 ? best + step * std::clamp(0.5 * (below - above) / bend, -0.5, 0.5) : best);
    std::vector<double> slope;
    for (std::size_t r = 0; r < modes_.size(); ++r)
      slope.push_back(here.match.slope[r] * std::log(high.units.power[r] / low.units.power[r]) / (2 * step * finest));
    return slope;
  }

  /// How the power grows with the strength is found by simulating at another one: where the first one fits at once,
  /// too, since what is known of the strength depends on it. Returns how the last one but for a small step fits.
  Try solve_for_strength(const ParameterSpec& amplitude) {
    constexpr double close = 0.05;  // of a logarithm: what few units have scatters more
    constexpr int most_rounds = 5;
    constexpr double elsewhere = 1.5;  // times the strength
    double& value = fit_.values[amplitude.name];
    Try tried = try_at(fit_.values);
    bool grew = false;
    const auto grows = [&](double from, const Try& at, double to, const Try& there) {
      const double moved = std::log(to / from);
      if (std::abs(moved) <= close) return;
      exponent_ = std::clamp((at.match.log_scale - there.match.log_scale) / moved, 0.5, 4.0);
      grew = true;
    };
    for (int round = 0; round < most_rounds && std::abs(tried.match.log_scale) > close; ++round) {
      const double before = value;
      const Try last = std::move(tried);
      value = std::clamp(before * std::exp(last.match.log_scale / exponent_), amplitude.lower, amplitude.upper);
      tried = try_at(fit_.values);
      if (tracing())
        fmt::print(stderr, "  {} {}: at {:.4g} units have {:.3f} of the power, at {:.4g} {:.3f}\n", hypothesis_.effect,
                   amplitude.name, before, std::exp(-last.match.log_scale), value, std::exp(-tried.match.log_scale));
      grows(before, last, value, tried);
    }
    if (!grew) {
      auto values = fit_.values;
      values[amplitude.name] =
          value * elsewhere < amplitude.upper ? value * elsewhere : std::max(value / elsewhere, amplitude.lower);
      grows(value, tried, values[amplitude.name], try_at(values));
    }
    // Frame by frame a hole is seen again: the fewer the frames, the less a dead pixel stands out.
    tried = try_whole(fit_.values);
    if (std::abs(tried.match.log_scale) > close) {
      value = std::clamp(value * std::exp(tried.match.log_scale / exponent_), amplitude.lower, amplitude.upper);
      if (tracing()) fmt::print(stderr, "  with all frames {:.4g}\n", value);
    }
    return tried;
  }

  const Layout& layout_;
  const Rung& rung_;
  const Hypothesis& hypothesis_;
  const Units units_;
  const std::vector<StatVector>& without_;
  const std::uint64_t seed_;
  UnitMapFit fit_;
  int segment_ = 0;
  std::vector<double> modes_;
  double exponent_ = 2;  // of power over strength: what it is of what is proportional to it
};

/// Mean squares of the first steps (Fisher's scores) from the values found to where other units would have led.
Eigen::VectorXd scatter_over_units(const Units& units, const Rung& rung, const UnitMapFit& fit,
                                   const Eigen::MatrixXd& inverse_information, std::uint64_t seed) {
  constexpr int rounds = 4;
  const UnitMapFit::Information& known = *fit.information;
  const std::vector<double> modes = known.map.modes(known.segment);
  std::vector<std::vector<double>> powers;  // by unit
  std::vector<double> mean(modes.size(), 0);
  for (int round = 1; round <= rounds; ++round)
    for (const Whitened& change : units.changes(fit.values, seed + 100 * static_cast<std::uint64_t>(round)))
      powers.push_back(known.map.spectrum_of_units(known.segment, {change}).power);
  for (const auto& power : powers)
    for (std::size_t r = 0; r < mean.size(); ++r) mean[r] += power[r] / static_cast<double>(powers.size());
  Eigen::VectorXd square = Eigen::VectorXd::Zero(inverse_information.rows());
  for (const auto& power : powers) {
    Eigen::VectorXd score = Eigen::VectorXd::Zero(square.size());
    for (int a = 0; a < score.size(); ++a)
      for (std::size_t r = 0; r < mean.size(); ++r)
        if (mean[r] > 0) score[a] += modes[r] / 2 * known.slopes[a][r] * known.share[r] * (power[r] / mean[r] - 1);
    square += (inverse_information * score).cwiseAbs2() / static_cast<double>(powers.size());
  }
  return square;
}

}  // namespace

UnitMapFit fit_unit_map(const Experiment& experiment, const Rung& rung, const Hypothesis& hypothesis,
                        const std::map<std::string, double>& values, UnitMap start,
                        const std::vector<StatVector>& without, std::uint64_t seed) {
  return MapFitter(experiment, rung, hypothesis, values, std::move(start), without, seed).run();
}

/// Fisher's information of rings of cosines; the units that are compared with are few, too. The mean square of values
/// that are rarely large (a few dead pixels) scatters by their kurtosis, where normal ones have 3. And the cosines of a
/// smooth map are not independent: what its border leaks is in all of them. So not less than other units, each taken
/// for the measured one, would scatter.
std::map<std::string, double> unit_map_deviations(const Experiment& experiment, const Rung& rung,
                                                  const Hypothesis& hypothesis, const UnitMapFit& fit,
                                                  std::uint64_t seed) {
  std::map<std::string, double> result;
  if (!fit.information) return result;
  const auto& [map, segment, names, slopes, kurtosis, share] = *fit.information;
  const std::vector<double> modes = map.modes(segment);
  const int n = static_cast<int>(names.size());
  Eigen::MatrixXd information = 1e-2 * Eigen::MatrixXd::Identity(n, n);
  for (int a = 0; a < n; ++a)
    for (int b = 0; b < n; ++b)
      for (std::size_t r = 0; r < modes.size(); ++r) information(a, b) += modes[r] / 2 * slopes[a][r] * slopes[b][r];
  const Eigen::MatrixXd inverse = information.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  const double few_units = 1 + 1 / map.learned_from();
  const Eigen::VectorXd by_units = scatter_over_units(Units(experiment, rung, hypothesis), rung, fit, inverse, seed);
  for (int a = 0; a < n; ++a) {
    const double by_information = std::max(1.0, (kurtosis - 1) / 2) * inverse(a, a);
    result[names[a]] = std::sqrt(few_units * std::max({0.0, by_information, by_units[a]}));
  }
  return result;
}

}  // namespace binrig
