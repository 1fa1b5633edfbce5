// Steps that recorded values seem to come in and simulated ones do not: values to try for hypotheses that are a step,
// and for the steps of a model that is calibrated.
#pragma once

#include <mutex>

#include "compare/value_steps.h"
#include "diagnose/experiment.h"
#include "diagnose/hypotheses.h"

namespace binrig {

/// The values of one frame of each train capture, its target where it nominally stands. Throws what simulating throws.
ValueSteps simulated_values(const Experiment& experiment, const SensorModel& model);
/// At most two of depth (0.02 to 20 mm) and two of disparity (1/128 to 1 px) that `values` have and `usual` ones do
/// not, see ValueSteps.
SeenSteps seen_steps(const ValueSteps& values, const ValueSteps& usual);
/// The model less the effects whose amplitude is a step: what its values usually are without these.
SensorModel without_steps(SensorModel model, const EffectCatalogue& catalogue);

/// Looks at the values of the train captures as they are read. What is given to the constructor must outlive it.
class StepReader {
 public:
  StepReader(const Experiment& experiment, const Experiment::FrameReader& frames)
      : experiment_(experiment), frames_(frames) {}

  /// Reads as `frames` does, from several threads, too. As long as this object.
  Experiment::FrameReader reader();
  /// See seen_steps. What is usual, the values simulated with `model` say: the storage step, steps that the model has,
  /// flat targets at few distances. Throws what simulating throws.
  SeenSteps seen(const SensorModel& model) const;

 private:
  const Experiment& experiment_;
  const Experiment::FrameReader& frames_;
  std::mutex guard_;
  ValueSteps values_;
};

}  // namespace binrig
