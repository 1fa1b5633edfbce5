#include "diagnose/adding.h"

#include <algorithm>
#include <cmath>

#include "diagnose/anew.h"

namespace binrig {

/// With its own parameters where the user put them.
SensorModel with_values_of(const SensorModel& given, SensorModel model) {
  for (auto& instance : model.effects)
    if (const EffectInstance* its = given.find(instance.id)) instance.values = its->values;
  return model;
}

Rung Adding::to(const Rung& rung, const Refined& hypothesis, RungOptions options, bool anew) const {
  if (!hypothesis.step_seen) options.scan_ranges_of = hypothesis.id;
  options.narrow = narrow_of(rung.fit.parameters);
  hold(hypothesis, options);
  return fit_rung(experiment_, motions_, measured_, anew ? with_values_of(given_, hypothesis.model) : hypothesis.model,
                  anew ? std::vector<Offset>{} : rung.offsets, options);
}

std::optional<Rung> Adding::to_the_given(const Rung& rung, const Hypothesis& hypothesis, RungOptions options) const {
  const SensorModel start = with_values_of(given_, rung.model);
  Hypotheses one;
  one.tested.push_back(hypothesis);
  SignatureBook book(experiment_, start, one, SignatureOptions{.seed = seed_ * 7001});
  for (const bool detail : {false, true}) book.look_at({0}, detail);
  const auto anew = look_anew(experiment_, motions_, measured_, {start, book.signatures(), book.simulations()}, one, -1,
                              1, seed_ * 60);
  if (anew.empty()) return {};
  options.scan_ranges_of = anew[0].id;
  options.narrow = narrow_of(rung.fit.parameters);
  return fit_rung(experiment_, motions_, measured_, anew[0].fit.model, {}, options);
}

std::optional<Rung> Adding::lens_put_back(const Rung& rung, const std::string& id, RungOptions options) const {
  constexpr double alike = 0.7, far = 2;  // cosine; stated deviations of the lens
  const Layout& layout = experiment_.layout();
  const auto rows = motion_rows(layout, rung.standard, motions_);
  SensorModel model = rung.model;
  Eigen::VectorXd value = rung.fit.value;
  std::vector<double> stands = values_of(motions_, rung.offsets);
  bool moved = false;
  for (std::size_t m = 0; m < motions_.size(); ++m) {
    if (motions_[m].capture >= 0 || std::abs(rung.nuisances[m]) < far) continue;
    for (std::size_t p = 0; p < rung.fit.parameters.size(); ++p) {
      const FitParameter& parameter = rung.fit.parameters[p];
      if (parameter.id != id) continue;
      double lens = 0, effect = 0, both = 0;
      for (int i = 0; i < layout.size; ++i) {
        const double row = rows[m].change[i], slope = rung.fit.slopes[p][i];
        if (row != 0) lens += row * row, effect += slope * slope, both += row * slope;
      }
      if (effect == 0 || std::abs(both) < alike * std::sqrt(lens * effect)) continue;
      value[p] += rung.nuisances[m] * both / effect;
      value_in(model, id, parameter.name).value =
          std::clamp(parameter.natural(value[p]), parameter.lower, parameter.upper);
      stands[m] = 0;
      moved = true;
      break;
    }
  }
  if (!moved) return {};
  options.narrow = narrow_of(rung.fit.parameters);
  return fit_rung(experiment_, motions_, measured_, model, offsets_of(layout, motions_, stands, {}), options);
}

void Adding::hold(const Refined& hypothesis, RungOptions& options) {
  if (!hypothesis.held && !hypothesis.step_seen) return;
  for (const auto& [name, value] : hypothesis.model.find(hypothesis.id)->values)
    if (value.ci95) options.fixed.push_back(hypothesis.id + "." + name);
}

}  // namespace binrig
