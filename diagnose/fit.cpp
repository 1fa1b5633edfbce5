#include "diagnose/fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "diagnose/descent.h"
#include "diagnose/hypotheses.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

/// Tries values where no slope leads: of narrow parameters, of whole numbers, and of masks' strengths.
class Seeker {
 public:
  Seeker(Descent& descent, const Experiment& experiment, const FitOptions& options)
      : descent_(descent),
        catalogue_(experiment.forward().catalogue()),
        layout_(experiment.layout()),
        cols_(experiment.nominal(0).depth_mm.cols),
        options_(options) {}

  /// Whole numbers value by value; periods, steps and places until they are so near that they can be fitted with all
  /// others. True if there are such.
  bool scan() {
    std::vector<FitParameter> near;
    for (const auto& id : options_.scan_ids) {
      if (!model().find(id)) continue;
      const EffectDeclaration& declaration = model().find(id)->declaration(catalogue_);
      const auto& specs = declaration.parameters;
      const bool has_phase = std::any_of(specs.begin(), specs.end(),
                                         [](const ParameterSpec& spec) { return spec.kind == ParameterKind::phase; });
      for (const auto& spec : specs) {
        if (fixed(id, spec.name)) continue;
        if (spec.kind == ParameterKind::integer) {
          walk(id, spec, 0.25, 2);
          continue;
        }
        if (spec.interpolate || is_fitted(id, spec.name)) continue;
        const double closeness = approach(id, spec, has_phase);
        // How a step's comb meets the data changes within thousandths: no slope leads there. A place has a side and is
        // no step: its trace moves smoothly.
        if (spec.either_sign || spec.name != declaration.amplitude)
          near.push_back(fit_parameter(*model().find(id), spec, closeness));
      }
    }
    if (near.empty()) return false;
    descent_.also_fit(near);
    return true;
  }

  /// Strengths of what touches few captures or shows other pixels valid, and where depth comes in steps of what moves
  /// it, near and far, and what moves nothing when it moves a little (a width that lies between two pixels), far: to
  /// either side, as long as it helps; true if anything did.
  bool probe() {
    bool moved = false;
    const bool in_steps = std::ranges::any_of(
        model().effects, [&](const EffectInstance& i) { return is_step(i.declaration(catalogue_)); });
    const auto& parameters = descent_.parameters();
    for (int p = 0; p < static_cast<int>(parameters.size()); ++p) {
      const FitParameter& parameter = parameters[p];
      const EffectDeclaration& declaration = model().find(parameter.id)->declaration(catalogue_);
      const double touched = descent_.touched_share(p);
      // Lines of steps come and go as targets move, and what is left of them hides that all would rather move along.
      const bool shifts_lines = in_steps && declaration.parameter(parameter.name)->either_sign;
      const bool rough =
          parameter.name == declaration.amplitude && (touched <= 0.5 || declaration.may_clear || shifts_lines);
      const bool still = touched == 0 && !parameter.circular;
      if (!rough && !still) continue;
      std::array<bool, 2> barren{};  // what changes nothing far away changes nothing on the way there
      for (const double reach : still ? std::array{2.0, 1.0, 0.5} : std::array{0.5, 0.12, 0.03})
        for (const bool down : {false, true}) {
          if (barren[down]) continue;
          while (goes(p, (down ? -1 : 1) * reach * parameter.longest)) moved = true;
          barren[down] = still && last_probe_changed_nothing_;
        }
    }
    return moved;
  }

 private:
  static constexpr double two_sigma = 4;  // of chi, in units of its mean square

  const SensorModel& model() const { return descent_.now().model; }
  double value(const std::string& id, const ParameterSpec& spec) const { return model().find(id)->value(spec.name); }

  /// Of the misfit, for which a value is taken.
  double worthwhile() const { return least_gain * descent_.now().dispersion; }

  /// Moves a parameter if chi falls by more than chance.
  bool goes(int p, double by) {
    Eigen::VectorXd x = descent_.now().value;
    x[p] += by;
    x = descent_.within_bounds(x);
    last_probe_changed_nothing_ = true;
    if (x == descent_.now().value) return false;
    FitState next = descent_.evaluate(x);
    last_probe_changed_nothing_ = next.residual == descent_.now().residual;
    if (next.chi > descent_.now().chi - two_sigma * descent_.now().dispersion) return false;
    if (goes_everywhere(p, next)) return false;
    if (tracing()) {
      const FitParameter& parameter = descent_.parameters()[p];
      fmt::print(stderr, "  {}.{} = {:.4g}: chi {:.0f} (was {:.0f})\n", parameter.id, parameter.name,
                 parameter.natural(x[p]), next.chi, descent_.now().chi);
    }
    descent_.move_to(std::move(next));
    return true;
  }

  /// Does a mask that acts in few captures begin to act in nearly all because its border gets wider? What happens to
  /// pixels at random can be made of a border that lies everywhere and anew in each frame; but that is another effect.
  bool goes_everywhere(int p, const FitState& next) const {
    constexpr double few = 0.5, nearly_all = 0.9;  // of the captures
    const FitParameter& parameter = descent_.parameters()[p];
    const EffectDeclaration& declaration = model().find(parameter.id)->declaration(catalogue_);
    if (!declaration.reason || parameter.name == declaration.amplitude) return false;
    if (descent_.touched_share(p) > few) return false;
    const Whitened &here = descent_.now().residual, nothing(here.size(), 0.f);
    return static_cast<double>(captures_that_differ(layout_, next.residual, here).size()) >
           nearly_all * static_cast<double>(captures_that_differ(layout_, here, nothing).size());
  }

  /// Chi. Where something else is missing, what a wrong step does to the noise that lacks it may outweigh the lines
  /// that only the right one draws: there it is how near every block comes.
  double misfit(const FitState& state, bool of_step) const {
    const double dispersion = descent_.now().dispersion;
    if (!of_step || dispersion <= far_off) return state.chi;
    return dispersion * misfit_by_blocks(layout_, state.residual);
  }

  /// Tries a value of a parameter that is not fitted; keeps it if the misfit falls. Returns by how much it does.
  double try_value(const std::string& id, const ParameterSpec& spec, double wanted) {
    wanted = std::clamp(wanted, spec.lower, spec.upper);
    if (wanted == value(id, spec)) return -std::numeric_limits<double>::infinity();
    FitState next = spec.kind == ParameterKind::integer ? descent_.evaluate_and_follow(id, spec.name, wanted)
                                                        : descent_.evaluate(id, spec.name, wanted);
    if (tracing())
      fmt::print(stderr, "  {}.{} = {:.5g}: chi {:.0f} (best {:.0f})\n", id, spec.name, wanted, next.chi,
                 descent_.now().chi);
    const bool step = is_step(model().find(id)->declaration(catalogue_), spec);
    double gain = misfit(descent_.now(), step) - misfit(next, step);
    // The step of an effect that is not being sought is not left for one that explains less in all.
    if (id != options_.scan_ranges_of) gain = std::min(gain, descent_.now().chi - next.chi);
    if (gain > worthwhile()) descent_.move_to(std::move(next));
    return gain;
  }

  /// Brings a narrow parameter near its best value. Returns how near.
  double approach(const std::string& id, const ParameterSpec& spec, bool has_phase) {
    if (spec.either_sign) {
      walk(id, spec, 0.06, 5);
      walk(id, spec, 0.03, 1);
      return 0.015 * spec.typical_high;
    }
    if (!has_phase && spec.log_scaled && spec.typical_low > 0 &&
        (options_.scan_all_ranges || id == options_.scan_ranges_of))
      return has_place(model().find(id)->declaration(catalogue_)) ? scan_range(id, spec, 11, 1.01)
                                                                  : scan_range(id, spec, 21, 1.003);
    if (has_phase) return 0.1 * period_spacing(spec, value(id, spec), cols_);
    walk_octaves(id, spec);
    walk(id, spec, 0.2, 2);
    walk(id, spec, 0.05, 2);
    return 0.003;
  }

  /// Periods and steps have narrow valleys (21 values over 5 octaves: every power of two), how far something reaches
  /// about its place has a wider one: the whole typical range, then closer and closer about the best. Returns how close
  /// that came, relative to the value.
  double scan_range(const std::string& id, const ParameterSpec& spec, int places, double closest) {
    const double ratio = std::pow(spec.typical_high / spec.typical_low, 1.0 / (places - 1));
    // What adds chi once more to the misfit twice in a row adds more and more from there on.
    int hopeless = 0;
    for (int k = 0; k < places && hopeless < 2; ++k) {
      const double wanted = spec.typical_low * std::pow(ratio, k);
      const bool beyond = wanted > value(id, spec);
      hopeless = try_value(id, spec, wanted) < -descent_.now().chi && beyond ? hopeless + 1 : 0;
    }
    double r = std::sqrt(ratio);
    while (r > closest) {
      const double best = value(id, spec);
      const double up = try_value(id, spec, best * r);
      if (up > worthwhile()) continue;
      const double down = try_value(id, spec, best / r);
      if (down > worthwhile()) continue;
      if (std::min(up, down) > -two_sigma * descent_.now().dispersion) break;
      r = std::sqrt(r);
    }
    return std::log(r);
  }

  /// Step by step to either side, as long as it helps.
  void walk(const std::string& id, const ParameterSpec& spec, double share, int most) {
    for (const double direction : {1.0, -1.0})
      for (int moves = 0; moves < most; ++moves) {
        const double best = value(id, spec);
        const double step = spec.kind == ParameterKind::integer ? std::max(1.0, std::round(share * best))
                            : spec.either_sign                  ? share * spec.typical_high
                                                                : share * best;
        const double gain = try_value(id, spec, best + direction * step);
        if (spec.kind == ParameterKind::integer && gain == 0) {  // an even diameter is the odd one above it
          if (try_value(id, spec, best + 2 * direction * step) <= worthwhile()) break;
        } else if (gain <= worthwhile()) {
          break;
        }
      }
  }

  /// Twice and half as much, as long as it helps: among the teeth of a comb every other one fits nearly as well, and
  /// what the model lacked when one was chosen may be in it now.
  void walk_octaves(const std::string& id, const ParameterSpec& spec) {
    if (!spec.log_scaled) return;
    for (const double factor : {2.0, 0.5})
      while (try_value(id, spec, factor * value(id, spec)) > worthwhile()) {
      }
  }

  bool fixed(const std::string& id, const std::string& name) const {
    return std::find(options_.fixed.begin(), options_.fixed.end(), id + "." + name) != options_.fixed.end();
  }

  bool is_fitted(const std::string& id, const std::string& name) const {
    const auto& parameters = descent_.parameters();
    return std::any_of(parameters.begin(), parameters.end(),
                       [&](const FitParameter& p) { return p.id == id && p.name == name; });
  }

  Descent& descent_;
  const EffectCatalogue& catalogue_;
  const Layout& layout_;
  const int cols_;
  const FitOptions& options_;
  bool last_probe_changed_nothing_ = false;
};

}  // namespace

Fit fit_model(const Experiment& experiment, const Standard& standard, const Metric& metric, const Whitened& data,
              const SensorModel& start, const std::vector<FitParameter>& parameters, const std::vector<Offset>& offsets,
              const FitOptions& options) {
  Descent descent(experiment, standard, metric, data, parameters, start, offsets, options);
  Seeker seeker(descent, experiment, options);
  descent.run();
  if (seeker.scan()) descent.run();
  const double left =
      std::min(descent.now().dispersion, left_by_most_captures(experiment.layout(), descent.now().residual));
  if (left <= options.probe_within && seeker.probe()) descent.run();
  return std::move(descent).result();
}

}  // namespace binrig
