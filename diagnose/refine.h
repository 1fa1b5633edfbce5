// A hypothesis simulated on top of a rung's model: what it leaves of the data, and its parameters fitted to them.
#pragma once

#include <string>
#include <vector>

#include "diagnose/signatures.h"

namespace binrig {

/// What all hypotheses of a search share; `seeds` simulations each. All of it must outlive the calls.
struct Refiner {
  const Experiment& experiment;
  const std::vector<SceneMotion>& motions;
  const Rung& rung;
  const Measurement& measured;
  int seeds = 2;
  std::uint64_t seed = 501;
  Part part = Part::all;  ///< what is simulated
  int most_frames = 0;    ///< of Trial; Measurement must have them
};
/// As many frames as hypotheses on top of a rung are simulated with: all (0), or where it is far off, as few as the
/// fits that follow see.
int frames_for(const Rung& rung);
/// The same for trying one value after another: train alone.
Refiner on_train(Refiner refiner);

/// What a model leaves of the data, by part; 0 of what is not simulated.
struct Remainder {
  Whitened mean;
  double train = 0, test = 0;  ///< chi
  double scatter = 0;          ///< of the model's recordings of train about their mean, in the same unit
  std::vector<double> values;  ///< of the nuisances, in prior sigmas from nominal
};
/// `offsets`, `place`: where the targets stand (Metric::explain). Throws what simulating throws.
Remainder remainder_of(const Refiner& refiner, const SensorModel& model, const std::vector<Offset>& offsets,
                       const std::vector<double>& place);
/// The same, the targets where this model wants them.
Remainder registered_remainder(const Refiner& refiner, const SensorModel& model);

/// Square of a change by capture, added to what is there.
void add_power(const Layout& layout, const Whitened& change, std::vector<double>& power);

/// The rung's model with the hypothesis, its parameters fitted to the train captures; `id`: of the instance added.
/// Throws what simulating throws.
struct RefinedFit {
  std::string id;
  Fit fit;
};
RefinedFit refine(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start);

}  // namespace binrig
