// What could be missing: every effect of the catalogue that the model lacks, made into a handful of models to simulate.
// Nothing is known of an effect here but its declaration.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "compare/value_steps.h"
#include "core/forward_model.h"

namespace binrig {

/// One model to simulate: the base with one effect added at these values.
struct Atom {
  std::map<std::string, double> values;
};

/// Atoms of growing strength at one setting of the other parameters. Between "absent" and the atoms, the trace in the
/// data is interpolated unless the amplitude is discrete: then every atom stands for itself.
struct StrengthPath {
  std::vector<Atom> atoms;
  bool interpolate = true;
  bool mirror = false;     ///< the opposite sign is taken as the opposite trace; else it has a path of its own
  int quadrature_of = -1;  ///< index of the path a quarter period before: both together span every phase
  /// Looked at only where the hypothesis' other paths explain something: it differs from the first one by a parameter
  /// that changes the trace little by little.
  bool detail = false;
  bool one_of_many = false;  ///< of a grid of places: each is simulated once, not with several seeds
};

struct Hypothesis {
  std::string effect;
  const EffectDeclaration* declaration = nullptr;
  std::vector<StrengthPath> paths;
  std::vector<ReadStep> seen;  ///< of a step: values of its amplitude that are of SeenSteps

  /// The step that was seen which these values are the hypothesis at; null if at none.
  const ReadStep* seen_at(const std::map<std::string, double>& values) const;
};

/// Effects that this recording could not show: name and unmet needs.
struct Untested {
  std::string effect;
  std::vector<std::string> needs;
};

struct Hypotheses {
  std::vector<Hypothesis> tested;
  std::vector<Untested> untested;
};

/// The hypothesis with one period each: that of `values`, then equal steps in its inverse over the typical range, so
/// close that neighbours differ by one period across an image of `cols`; all else as in `values`, at medium strength.
/// None if it has no phase or no period.
std::vector<Hypothesis> by_period(const Hypothesis& hypothesis, const std::map<std::string, double>& values, int cols);
/// The same about the period of `values`, as far as its neighbours would be, a quarter of such a step apart.
std::vector<Hypothesis> by_period_near(const Hypothesis& hypothesis, const std::map<std::string, double>& values,
                                       int cols);
/// True if an effect has a phase and a period.
bool has_period(const EffectDeclaration& effect);
/// True if an effect has a parameter (no strength) of which each value is a trace of its own, without a phase that
/// would make it a wave, and that is no place: the frequency of a ring in the spectrum.
bool has_tone(const EffectDeclaration& effect);
/// True if an effect has a place in the image: two parameters of either sign of which each value is another trace.
bool has_place(const EffectDeclaration& effect);

/// True of an amplitude that is a step (of a quantisation), not a period or a place: slopes say nothing of it, and
/// where it is wrong its comb misses the data's everywhere.
bool is_step(const EffectDeclaration& effect, const ParameterSpec& spec);
/// True of an effect with such an amplitude.
bool is_step(const EffectDeclaration& effect);
/// The hypothesis with its place close together around that of `values`, each at three strengths: `reach` to all sides
/// (in its own unit), or as far as the next one of the grid. No paths if it has none.
Hypothesis by_place(const Hypothesis& hypothesis, const std::map<std::string, double>& values,
                    std::optional<double> reach = {});
/// The values with an effect's place at (x, y), in its own unit: halves of the image's width from the principal point.
/// Precondition: has_place.
std::map<std::string, double> placed_at(const EffectDeclaration& effect, std::map<std::string, double> values, double x,
                                        double y);
/// How far apart periods of by_period are near a value, relative to it.
double period_spacing(const ParameterSpec& period, double value, int cols);

/// Steps that the recorded values seem to come in and the model's do not, see StepReader.
struct SeenSteps {
  std::vector<ReadStep> depth_mm, disparity_px;
  /// Those in the unit of an amplitude that is a step.
  const std::vector<ReadStep>& of(const ParameterSpec& step) const {
    return step.unit == "px" ? disparity_px : depth_mm;
  }
};

/// Every effect of the catalogue that the model lacks and the recording could show. A step of depth or of disparity
/// (is_step, by its unit) is tried at what was seen, too.
Hypotheses make_hypotheses(const ForwardModel& forward, const SensorModel& model, const SeenSteps& seen = {});

/// The model with the effect added at the values.
SensorModel with_effect(const SensorModel& model, const EffectCatalogue& catalogue, const std::string& effect,
                        const std::map<std::string, double>& values);
/// The model less the instance with that id, if it has one.
SensorModel without_effect(SensorModel model, const std::string& id);

}  // namespace binrig
