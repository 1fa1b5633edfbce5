#include "diagnose/adding.h"

#include "diagnose/anew.h"

namespace binrig {

/// With its own parameters where the user put them.
SensorModel with_values_of(const SensorModel& given, SensorModel model) {
  for (auto& instance : model.effects)
    if (const EffectInstance* its = given.find(instance.id)) instance.values = its->values;
  return model;
}

Rung Adding::to(const Rung& rung, const Refined& hypothesis, RungOptions options, bool anew) const {
  options.scan_ranges_of = hypothesis.id;
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

void Adding::hold(const Refined& hypothesis, RungOptions& options) {
  if (!hypothesis.held) return;
  for (const auto& [name, value] : hypothesis.model.find(hypothesis.id)->values)
    if (value.ci95) options.fixed.push_back(hypothesis.id + "." + name);
}

}  // namespace binrig
