// What is fitted, on which scale, and what is written of it (diagnose/fit.h).
#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

#include "core/error.h"
#include "diagnose/fit.h"

namespace binrig {

double FitParameter::scaled(double value) const { return logarithmic ? std::log(std::max(value, 1e-12)) : value; }

double FitParameter::natural(double scaled_value) const {
  if (circular) {
    double wrapped = std::fmod(scaled_value - lower, 2 * std::numbers::pi);
    if (wrapped < 0) wrapped += 2 * std::numbers::pi;
    return std::clamp(lower + wrapped, lower, upper);
  }
  return std::clamp(logarithmic ? std::exp(scaled_value) : scaled_value, lower, upper);
}

FitParameter fit_parameter(const EffectInstance& instance, const ParameterSpec& spec, double closeness) {
  FitParameter p;
  p.id = instance.id;
  p.name = spec.name;
  p.unit = spec.unit;
  p.lower = spec.lower;
  p.upper = spec.upper;
  p.circular = spec.kind == ParameterKind::phase;
  p.narrow = !spec.interpolate;
  const double low = spec.typical_low, high = spec.typical_high, width = std::abs(high - low);
  const double value = instance.value(spec.name);
  p.logarithmic = spec.log_scaled && spec.lower >= 0 && value > 0 && !spec.either_sign;
  if (p.logarithmic) {
    if (p.lower <= 0) p.lower = std::max(1e-9, std::min(low, value) * 1e-3);
    p.prior_sigma = std::max(1.0, 0.5 * std::log(std::max(high, 1e-9) / std::max(low, 1e-9)));
    p.step = 0.1;
    p.longest = 0.5;
  } else if (p.circular) {
    p.prior_sigma = 4;
    p.step = 0.15;
    p.longest = 0.8;
  } else {
    const double scale = spec.either_sign ? std::abs(high) : std::max(width, 1e-9);
    p.prior_sigma = scale;
    p.step = 0.05 * scale;
    p.longest = 0.25 * scale;
  }
  if (p.narrow && closeness > 0) {
    p.step = closeness;
    p.longest = 4 * closeness;
  }
  p.prior_centre = p.scaled(value);
  return p;
}

ParameterValue& value_in(SensorModel& model, const std::string& id, const std::string& name) {
  for (auto& instance : model.effects)
    if (instance.id == id) return instance.values.at(name);
  throw Error("the model has no " + id);
}

SensorModel with_values(SensorModel model, const std::vector<FitParameter>& parameters, const Eigen::VectorXd& x) {
  for (std::size_t p = 0; p < parameters.size(); ++p)
    value_in(model, parameters[p].id, parameters[p].name).value = parameters[p].natural(x[static_cast<int>(p)]);
  return model;
}

std::vector<FitParameter> fit_parameters(const SensorModel& model, const EffectCatalogue& catalogue,
                                         const std::vector<std::string>& ids) {
  std::vector<FitParameter> result;
  for (const auto& instance : model.effects) {
    if (!ids.empty() && std::find(ids.begin(), ids.end(), instance.id) == ids.end()) continue;
    for (const auto& spec : instance.declaration(catalogue).parameters)
      if (spec.kind != ParameterKind::integer && spec.interpolate && spec.lower != spec.upper)
        result.push_back(fit_parameter(instance, spec));
  }
  return result;
}

std::vector<FitParameter> narrow_of(const std::vector<FitParameter>& parameters) {
  std::vector<FitParameter> result;
  std::copy_if(parameters.begin(), parameters.end(), std::back_inserter(result),
               [](const FitParameter& p) { return p.narrow; });
  return result;
}

Eigen::VectorXd half_intervals(const Fit& fit, double dispersion) {
  const int n = static_cast<int>(fit.parameters.size());
  if (fit.half_interval.size() == n || fit.precision.rows() != n) return fit.half_interval;
  const Eigen::MatrixXd covariance = fit.precision.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  Eigen::VectorXd deviation = (dispersion * covariance.diagonal()).cwiseMax(0).cwiseSqrt();
  if (fit.scatter.size() == n) deviation = deviation.cwiseMax(fit.scatter);
  // The simulations that the data were compared with scatter, too: two of them, as far as the data do.
  return 1.96 * std::sqrt(1.5) * deviation;
}

bool may_be_nothing(const Fit& fit, const Eigen::VectorXd& half, const std::string& id,
                    const EffectDeclaration& effect) {
  const ParameterSpec* spec = effect.parameter(effect.amplitude);
  if (!spec || !spec->neutral || half.size() != static_cast<long>(fit.parameters.size())) return false;
  for (int p = 0; p < half.size(); ++p) {
    const FitParameter& parameter = fit.parameters[p];
    if (parameter.id != id || parameter.name != effect.amplitude || parameter.logarithmic) continue;
    return parameter.natural(fit.value[p] - half[p]) <= *spec->neutral &&
           *spec->neutral <= parameter.natural(fit.value[p] + half[p]);
  }
  return false;
}

void write_intervals(SensorModel& model, const Fit& fit, double dispersion, const std::string& provenance) {
  const int n = static_cast<int>(fit.parameters.size());
  const Eigen::VectorXd half = half_intervals(fit, dispersion);
  if (n == 0 || half.size() != n) return;
  for (int p = 0; p < n; ++p) {
    const auto& parameter = fit.parameters[p];
    const auto instance = std::find_if(model.effects.begin(), model.effects.end(),
                                       [&](const EffectInstance& e) { return e.id == parameter.id; });
    if (instance == model.effects.end()) continue;
    auto& value = instance->values[parameter.name];
    value.value = parameter.natural(fit.value[p]);
    if (parameter.circular)
      value.ci95 = {{value.value - half[p], value.value + half[p]}};
    else
      value.ci95 = {{parameter.natural(fit.value[p] - half[p]), parameter.natural(fit.value[p] + half[p])}};
    value.provenance = provenance;
  }
}

}  // namespace binrig
