// The climb from a model to one that explains the recording, effect by effect.
#pragma once

#include "diagnose/diagnose.h"

namespace binrig {

/// What was climbed: the first rung is of the model given, the last one of the model that explains most.
struct Climbed {
  std::vector<Rung> rungs;
  std::vector<std::string> added, removed;  ///< effects, by rung; "" = none
  RungOptions options;                      ///< of the last rung's fit
  Evidence evidence;                        ///< of what was accepted
  std::vector<CandidateReport> candidates;  ///< what was accepted, without parameters and scores
  std::vector<LinearRank> ranking;          ///< all hypotheses, beside the model given
  std::vector<Unconfirmed> unconfirmed;     ///< beside the last model
  std::vector<std::string> warnings;        ///< what was tried and taken out again
  bool as_many_as_allowed = false;          ///< were added: beside them nothing was looked for
};

/// Fits `model`, adds the best of the hypotheses as long as one lowers the error on captures held out, and takes out
/// again what later ones made superfluous. `motions`: of scene_motions for this experiment and model. Throws what
/// simulating throws.
Climbed climb(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
              const SensorModel& model, const Hypotheses& all, const DiagnosisOptions& options);

/// "train/000003 tilt 20 deg": as users know it.
std::string capture_name(const Experiment& experiment, int capture);

}  // namespace binrig
