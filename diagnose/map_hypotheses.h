// The hypotheses of a search that draw a map of the unit: learned, judged and fitted by what the map looks like. And
// those that draw one in each capture: learned and judged by what such maps look like.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "diagnose/drawn_map.h"
#include "diagnose/refine.h"
#include "diagnose/unit_map.h"

namespace binrig {

/// The constructor's references must outlive it.
class MapHypotheses {
 public:
  /// `no_maps`: effects of which the map is not fitted again.
  MapHypotheses(const Experiment& experiment, const Rung& rung, const Measurement& measured,
                const Hypotheses& hypotheses, std::set<std::string> no_maps, std::uint64_t seed);

  /// Simulates units with each of these hypotheses where the linear view puts it; where there is a map worth a look,
  /// its parameters are written to `linear`. Gains of maps that look random are added to theirs, and so are those of
  /// draws that look like what is left, with their strength, where wrong noise from frame to frame cannot be the cause.
  /// Throws what simulating throws.
  void learn(std::vector<LinearGain>& linear);
  /// What the maps gain of a residual in which nothing is missing, added to each one's gain. `rest`: of Rung::train.
  void add_gains(const Whitened& rest, std::vector<LinearGain>& gains) const;

  /// Of hypothesis h on the data; nothing if it draws no map or none that looks random, or like the data's.
  UnitMap::Gain gain(int h) const;
  /// False: it draws a map, but what is fixed in the image looks like none.
  bool looks_random(int h) const { return !maps_.count(h) || gains_.count(h); }
  /// Effects of which the map was fitted and does not look random, or not fitted again (`no_maps`).
  std::set<std::string> unlike() const;
  /// The map says what there is to know of its parameters.
  bool gives_parameters(int h) const { return maps_.count(h) && maps_.at(h).information; }
  /// It draws a map in each capture, and what is left looks like such draws: on the scale of a model without them a fit
  /// would walk to none, so that `linear` says where to begin with a model that has them.
  bool begins_with_draws(int h) const { return drawn_.count(h) && gains_.count(h); }
  /// The rung's model with the effect as its map has it: `values` with the intervals of those fitted.
  RefinedFit given_by_map(int h, const std::map<std::string, double>& values) const;

 private:
  std::vector<StatVector> simulate(const SensorModel& model) const;
  std::vector<StatVector> simulate_with(const Hypothesis& hypothesis,
                                        const std::map<std::string, double>& values) const;
  /// `without`: simulations of the rung's model; `best`: gain of the best hypothesis, whichever it is.
  void learn_map(LinearGain& linear, const std::vector<StatVector>& without, double best);
  void learn_draws(LinearGain& linear, const std::vector<StatVector>& without);
  bool shaped();

  const Experiment& experiment_;
  const Rung& rung_;
  const Measurement& measured_;
  const Hypotheses& hypotheses_;
  const std::set<std::string> no_maps_;
  const std::uint64_t seed_;
  std::optional<bool> shaped_;          // the bias has a simple shape
  std::map<int, UnitMapFit> maps_;      // by hypothesis; fitted if they are worth it
  std::map<int, DrawnMap> drawn_;       // the same
  std::map<int, UnitMap::Gain> gains_;  // of those that look random, or like the data's
};

}  // namespace binrig
