// A rung of the ladder: a model fitted to the train captures, with its own randomness and its nuisances.
#pragma once

#include <vector>

#include "diagnose/fit.h"
#include "diagnose/registration.h"

namespace binrig {

constexpr int fewest_frames = 2;           ///< of a capture, with which anything is fitted
constexpr double leaves_something = 1.05;  ///< dispersion of a model whose own randomness does not cover what is left
constexpr double leaves_little = 1.3;      ///< dispersion up to which places, masks and look-alikes are looked after
constexpr double many_missing = 8;         ///< dispersion of a model that lacks several effects: each has its turn

struct Rung {
  SensorModel model;
  Fit fit;                              ///< of the model's own parameters, on train
  std::vector<Offset> offsets;          ///< where the targets stand, given this model
  Standard standard;                    ///< from simulations of this model with random poses
  std::vector<StatVector> simulations;  ///< those simulations
  std::vector<Whitened> nulls;          ///< the same, whitened, not compressed: recordings in which nothing is missing
  std::vector<Standard> others;         ///< null k is whitened by others[k % size], learned without it
  Metric train, test;                   ///< poses, intrinsics and the model's own parameters marginalised
  std::vector<double> place;            ///< of the nuisances at `offsets`, see Metric::explain
  Whitened data;                        ///< y of the measurement, not compressed
  Whitened rest;                        ///< what the nuisances leave of it, compressed, train and test
  std::vector<double> nuisances;        ///< Remains::nuisances: where they stand, from the prior's centre
  Stated train_stated, test_stated;     ///< Remains
  double dispersion = 1;                ///< mean square of the residual on train over that of the nulls, at least 1
};

/// Frees what only the last rung of a ladder is asked for, which is most of its memory: nothing is fitted, searched or
/// judged from this one any more, only scored (scores, proper_score) and drawn.
void leave_behind(Rung& rung);

struct RungOptions {
  int simulations = 48;  ///< half as many where the dispersion is beyond 2; 8, if that is fewer, beyond 8
  int pose_draws = 12;   ///< different random registrations among the simulations
  int passes = 2, iterations = 8;
  double converged_far_off = 0;      ///< of FitOptions; if given, all passes are made with fewest_frames there
  std::string scan_ranges_of;        ///< of FitOptions, in the first pass
  bool scan_all_ranges = false;      ///< of FitOptions, in the first pass
  std::vector<FitParameter> narrow;  ///< of effects added before; fitted like the others
  std::vector<std::string> fixed;    ///< parameters, by id.name, that stay as they are
  std::uint64_t seed = 1;
};

/// What a rung's nuisances leave of a difference between data and simulations made with nuisances at `place`. Global
/// nuisances are found on train and carried over.
struct Remains {
  Whitened rest;  ///< train and test, compressed
  /// From the prior's centre: what all captures share as train wants it, each target as its own capture does.
  std::vector<double> nuisances;
  Stated train_stated, test_stated;
};
Remains remains_of(const Rung& rung, const Whitened& difference, const std::vector<double>& place);
/// The same with parameters of effects that `model` lacks held where they are: nothing stands in for what is not there.
Remains remains_of(const Rung& rung, const SensorModel& model, const Whitened& difference,
                   const std::vector<double>& place);

/// Parameters of the rung's model that are further from where `given` has them than so many standard deviations of
/// their wide priors, by id.name; of rungs whose places or masks were fitted since, too, whose priors stand at the last
/// fit. Those of effects that `given` lacks are left out, and those that the data do not know or a narrow prior holds.
std::vector<std::string> parameters_bent(const Rung& rung, const SensorModel& given, double deviations);

/// True if any of the model's effects has a need that a few frames do not show.
bool needs_whole_series(const SensorModel& model, const EffectCatalogue& catalogue);

/// Fits poses and parameters from a start and learns the model's randomness.
Rung fit_rung(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
              const SensorModel& start, const std::vector<Offset>& offsets, const RungOptions& options);

/// The rung of another model, or with targets elsewhere: nothing is fitted, its randomness is learned anew. Its priors
/// stand where this model does. `options`, `parameters`: with which, and with what fitted, the one before was made.
/// Throws what simulating throws.
Rung made_anew(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
               const SensorModel& model, const std::vector<Offset>& offsets, const RungOptions& options,
               const std::vector<FitParameter>& parameters);

/// A model as it is, simulated with targets about `offsets`: as much of a rung as `scores` asks of those that are not
/// the last. It has neither fit nor metrics, and nothing was taken from its data: `rest` is 0, so that its proper score
/// means nothing. Throws what simulating throws.
Rung unfitted_rung(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                   const SensorModel& model, const std::vector<Offset>& offsets, const RungOptions& options);

}  // namespace binrig
