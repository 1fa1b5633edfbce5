// What became of the parameters that a model had before anything was added.
#include <cmath>

#include "diagnose/diagnose.h"

namespace binrig {
namespace {

constexpr double half_width = 1.96;    // of a 95 % interval, in standard deviations
constexpr double least_learned = 0.7;  // a parameter whose scatter shrinks to no less than this share is not determined

}  // namespace

std::vector<PresentParameter> present_parameters(const SensorModel& given, const Rung& last,
                                                 const EffectCatalogue& catalogue) {
  std::vector<PresentParameter> result;
  const Fit& fit = last.fit;
  const int n = static_cast<int>(fit.parameters.size());
  const Eigen::VectorXd half = half_intervals(fit, last.dispersion);
  if (n == 0 || half.size() != n) return result;
  for (int p = 0; p < n; ++p) {
    const FitParameter& parameter = fit.parameters[p];
    const EffectInstance* before = given.find(parameter.id);
    if (!before) continue;
    const double sigma = half[p] / half_width;
    PresentParameter entry{parameter.id, parameter.name, parameter.unit, before->value(parameter.name)};
    entry.fitted = parameter.natural(fit.value[p]);
    entry.low = parameter.natural(fit.value[p] - half[p]);
    entry.high = parameter.natural(fit.value[p] + half[p]);
    const EffectDeclaration& effect = before->declaration(catalogue);
    const ParameterSpec* spec = effect.parameter(parameter.name);
    const bool anything = spec && entry.low <= spec->lower && entry.high >= spec->upper;
    entry.determined = !anything && sigma < least_learned * parameter.prior_sigma;
    entry.changed = entry.determined && (entry.given < entry.low || entry.given > entry.high);
    entry.superfluous =
        entry.determined && parameter.name == effect.amplitude && may_be_nothing(fit, half, parameter.id, effect);
    result.push_back(entry);
  }
  return result;
}

}  // namespace binrig
