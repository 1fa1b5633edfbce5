// What each hypothesis would change in the statistics, and how much of the residual that would explain.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "diagnose/hypotheses.h"
#include "diagnose/rung.h"

namespace binrig {

/// Simulated mean change of the statistics on train by one atom, each segment shrunk by its share of signal.
struct Signature {
  int hypothesis = 0, path = 0, atom = 0;
  std::shared_ptr<const StatVector> change;  ///< lists of some of a book's signatures share it
};

struct SignatureOptions {
  int seeds = 2;
  int rare_seeds = 8;  ///< of effects that happen to a frame or do not
  int most_frames = 3;
  std::uint64_t seed = 7001;
  std::vector<int> only;  ///< these captures; empty = all of train
  bool shared = true;     ///< the model does not depend on what was measured
  double map_share = 0;   ///< of shrunk_change
};

/// The model that signatures are made of: `given` with the strength of its noise (amplitudes on a logarithmic scale)
/// at the nearest power of 2 to the fitted one. What an effect changes in stabilised statistics hardly depends on the
/// other parameters, so that all recordings of a scene share their signatures.
SensorModel signature_model(const SensorModel& given, const SensorModel& fitted, const EffectCatalogue& catalogue);

/// Mean change over seeds (simulations of the same seeds without and with something), in the statistics' own units,
/// each segment shrunk by its share of signal; of maps in which other pixels toss in each seed, what they do in the
/// mean. `spread`: of Standard, 0 = unknown: no change. `map_share`: maps of which less is signal are taken for such.
StatVector shrunk_change(const Layout& layout, const std::vector<float>& spread, const std::vector<StatVector>& with,
                         const std::vector<StatVector>& without, double map_share = 0);

/// Signatures of some hypotheses about one model, simulated when they are asked for. Targets stand where they nominally
/// do. All arguments of the constructor must outlive it.
class SignatureBook {
 public:
  SignatureBook(const Experiment& experiment, SensorModel model, const Hypotheses& hypotheses,
                const SignatureOptions& options);
  /// Adds the signatures of a hypothesis' paths that are `detail`, or of those that are not. Throws what simulating
  /// throws.
  void look_at(const std::vector<int>& hypotheses, bool detail);
  /// By hypothesis, path and atom.
  const std::vector<Signature>& signatures() const { return signatures_; }
  /// The same, of which it keeps none.
  std::vector<Signature> take() { return std::exchange(signatures_, {}); }
  const SensorModel& model() const { return model_; }
  /// A few short recordings of the model itself (train; of Measurement::at(options.most_frames, false)).
  const std::vector<StatVector>& simulations() const { return without_[true]; }
  /// The same of another model, which may depend on what was measured. Throws what simulating throws.
  std::vector<StatVector> simulations_of(const SensorModel& model) const { return without(model, true, false); }

 private:
  std::vector<StatVector> without(const SensorModel& model, bool series, bool shared) const;
  Trial trial(const SensorModel& model, int seed, bool series) const;

  const Experiment& experiment_;
  const SensorModel model_;
  const Hypotheses& hypotheses_;
  const SignatureOptions options_;
  std::vector<StatVector> without_[2];  // series from power-on cut short, in full
  std::vector<float> spread_;
  std::vector<Signature> signatures_;
};

/// How well one hypothesis explains a residual, in the linear view of its signatures.
struct LinearGain {
  int hypothesis = 0;
  double gain = 0;                       ///< of chi on train
  std::map<std::string, double> values;  ///< parameters at the best place, to start a refinement from
};

/// Whitened signatures under a rung (which must outlive it), ready to be held against many residuals.
class Ranking {
 public:
  Ranking(const Experiment& experiment, const Rung& rung, const Hypotheses& hypotheses,
          const std::vector<Signature>& signatures);
  /// One entry a hypothesis, in their order. `rest` and `nuisances`: of Metric::explain on train.
  std::vector<LinearGain> gains(const Whitened& rest, const std::vector<double>& nuisances) const;

 private:
  struct Row {
    int hypothesis, path, atom;
    Whitened change;                // nuisances taken out, compressed
    std::vector<double> nuisances;  // that were taken out
  };
  struct PathData {
    int hypothesis, path;
    std::vector<int> rows;
    Eigen::MatrixXd gram;
  };
  LinearGain best_on(const PathData& path, const Eigen::VectorXd& projection, const PathData* quarter,
                     const Eigen::VectorXd& quarter_projection) const;

  double product(const Row& a, const Row& b) const;

  const Hypotheses& hypotheses_;
  const Metric& metric_;
  std::vector<Row> rows_;
  std::vector<PathData> paths_;
  std::vector<Eigen::MatrixXd> cross_;  // of a path with its quarter-period companion, by path
};

/// Gains of what a rung leaves, on train, by signatures that are simulated about its model for that alone: one entry a
/// hypothesis, in their order. Details are not looked at. Throws what simulating throws.
std::vector<LinearGain> gains_about(const Experiment& experiment, const Rung& rung, const Hypotheses& hypotheses,
                                    const SignatureOptions& options);

/// p-value of a gain against gains under the null: from a gamma distribution with their mean and variance, never below
/// what they resolve unless `extrapolated` is set.
struct PValue {
  double p = 1;
  bool extrapolated = false;
};
PValue gain_p_value(double gain, std::vector<double> null_gains);

}  // namespace binrig
