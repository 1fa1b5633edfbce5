// The cells of maps (bias, noise, drop-out) with what they may go with.
#pragma once

#include <string>
#include <vector>

#include "diagnose/rung.h"

namespace binrig {

/// What a cell is looked at over.
struct Covariate {
  std::string name;
  std::string in_formulas;  ///< as a formula effect knows it; "" = it does not
  std::string label;        ///< of an axis, with the unit
  double scale = 1;         ///< to that unit from that of MapCell::covariates (mm, rad, px)
};
const std::vector<Covariate>& covariates();

/// One cell of a map, at its centre in the nominal scene.
struct MapCell {
  int index;  ///< in the vector
  bool train;
  float residual;                  ///< whitened, nuisances taken out
  float change;                    ///< stabilised units: measured less simulated
  double x, y;                     ///< EFFECTS' image coordinates
  std::vector<double> covariates;  ///< in the order of covariates()
};

/// The cells of a segment that are known and on a surface, of all captures; empty where the segment has no maps. `data`
/// and what `rung` holds are of the experiment's layout. Throws what rendering throws.
std::vector<MapCell> cells_of(const Experiment& experiment, const Rung& rung, const StatVector& data,
                              const std::string& segment);

}  // namespace binrig
