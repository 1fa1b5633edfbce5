// Scores that users see, and whether anything is left to explain.
#pragma once

#include <set>
#include <string>
#include <utility>

#include "diagnose/diagnose.h"

namespace binrig {

/// Squared whitened residual plus logarithm of the determinant of the rung's own covariance, per element known of the
/// captures held out (or of another part): the smaller the better, and needless variance makes it larger. Source: the
/// logarithmic score of a normal distribution, without its constant.
double proper_score(const Layout& layout, const Rung& rung, Part part = Part::test);
/// A proper score lower by so much is clearly better: an element's, of captures held out.
constexpr double clearly_lower = 0.01;

/// The same on captures held out, the bias not in units of its spread, which has the practical floor in it, but of what
/// the rung's own simulations (it must have its nulls) leave of it: with their mean square c, y^2 becomes y^2 / c + ln c.
/// Where that floor is as wide as the noise, half of what an effect draws is in it already, and the other score is no
/// proper one for the draws: it may refuse those that are there and prefer some that are not. Without nulls or bias: the
/// other score.
double proper_score_without_floor_of_bias(const Layout& layout, const Rung& rung);

/// Scores of several models on the held-out captures, all in units of `last`'s randomness, its nuisances marginalised
/// but for the parameters of effects that a model lacks: they must not make up for it.
std::vector<Score> scores(const Layout& layout, const std::vector<SceneMotion>& motions, const Rung& last,
                          const StatVector& data, const std::vector<const Rung*>& rungs);

/// Sum of squares by capture: of all segments, or of all but the bias maps, by which targets are registered.
std::vector<double> squares_by_capture(const Layout& layout, const Whitened& rest, bool with_bias);
/// Captures whose squares beside bias are beyond two standard deviations of those of the rung's own simulations, and by
/// more than one element's noise: worth a look, no finding.
std::vector<int> captures_that_stand_out(const Layout& layout, const Rung& rung);

/// A segment on one side of the split against the model's own simulations. Beside the segments of the statistics there
/// are "poses" and "intrinsics": how far from nominal, in their stated uncertainty, targets must stand and the camera's
/// numbers be for the model to be right.
struct SegmentFit {
  std::string segment, group;
  bool train = true;
  double ratio = 1;            ///< mean square of the residual over the simulations'
  double excess = 0;           ///< the difference of these mean squares (1 = randomness and practical floor together)
  double spread = 0;           ///< standard deviation of the mean square among the simulations
  bool on_both_parts = false;  ///< beyond chance (six spreads) on train and on the captures held out
  bool significant() const;
};
std::vector<SegmentFit> goodness_of_fit(const Layout& layout, const Rung& rung);
/// Those that a rung's model leaves beyond its own randomness: segment, and whether on train.
using Leftovers = std::set<std::pair<std::string, bool>>;
Leftovers unexplained(const Layout& layout, const Rung& rung);

/// Is a rung's model far more random somewhere than the recording shows: are its squares there below its own
/// simulations' by more than six of their standard deviations and a twentieth of their unit?
bool needlessly_random(const Layout& layout, const Rung& rung);

}  // namespace binrig
