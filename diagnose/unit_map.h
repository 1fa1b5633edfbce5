// Effects that draw a map which belongs to the unit: nobody knows the map, but whatever it is, it is the same in all
// captures. What train captures show of it must then return in the captures held out.
#pragma once

#include <vector>

#include "diagnose/rung.h"

namespace binrig {

/// What an unknown map, common to all captures, explains of a residual.
///
/// Model: residual of cell i in capture c = l_c m_i + noise, m_i ~ N(0, a^2) independently. The loadings l_c are
/// learned from simulated units (leading eigenvector of the captures' second moments), the noise from the rung's nulls,
/// the strength a from train (empirical Bayes). A map that is smooth explains more than independent cells know of: the
/// gain is a lower bound.
class UnitMap {
 public:
  struct Gain {
    double train = 0;  ///< twice the logarithm of the marginal likelihood's ratio, times the noise's mean square
    double test = 0;   ///< of chi, by the map estimated on train
  };

  /// `without`: simulations of the rung's model (trials_of with it); `with`: of the model with the effect, same trials.
  UnitMap(const Layout& layout, const Rung& rung, const std::vector<StatVector>& without,
          const std::vector<StatVector>& with);
  /// Simulations to give to the constructor: a few units, all captures, targets where the rung has them.
  static std::vector<Trial> trials_of(const Rung& rung, const SensorModel& model, std::uint64_t seed);

  /// `train`, `test`: Explained::rest of either part. `only_segment`: what of the gain is in that; empty = all.
  Gain gain(const Whitened& train, const Whitened& test, const std::string& only_segment = "") const;
  /// Is the map estimated from a residual (all captures) like those of simulated units, by the distribution of its
  /// values and by how adjacent cells go together? A step or a wave is no random map, a spot is no scatter of dead
  /// pixels.
  bool looks_random(const Whitened& rest) const;

 private:
  struct Loading {
    int offset;  // of the capture's block
    bool train;
    double value;
  };
  struct Segment {
    std::string name;
    int cells = 0, cols = 0;
    std::vector<Loading> loadings;
    double noise = 1;      // mean square
    double kurtosis = 3;   // of simulated maps
    double neighbour = 0;  // correlation of adjacent cells, of simulated maps
  };
  /// Estimates of a map, cell by cell; 0 where nothing is known. `noise`: what chance adds to the sum of their squares.
  std::vector<double> map_of(const Segment& segment, const Whitened& rest, double& noise) const;
  /// Sums over captures of loading times residual and of loading squared, for one cell.
  void sums(const Segment& segment, int cell, const Whitened& rest, bool train, double& b, double& g) const;

  std::vector<float> spread_;
  std::vector<Segment> segments_;
};

}  // namespace binrig
