// The cells of maps (bias, noise, drop-out) with what they may go with.
#pragma once

#include <string>
#include <vector>

#include "diagnose/rung.h"

namespace binrig {

/// What a cell is looked at over: its name, what an axis of it says, and what its value is multiplied by for that.
struct Covariate {
  std::string name, label;
  double scale = 1;
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

/// The cells of a segment that are known and on a surface, of all captures.
std::vector<MapCell> cells_of(const Experiment& experiment, const Rung& rung, const StatVector& data,
                              const std::string& segment);

}  // namespace binrig
