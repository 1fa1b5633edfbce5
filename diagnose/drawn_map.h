// Effects that draw a map anew in each capture, which stays through it: nobody knows the draw, and no other capture has
// it. What can be compared is in which captures such a map shows, how strong it is there, and how fine.
#pragma once

#include <vector>

#include "diagnose/map_rings.h"
#include "diagnose/rung.h"

namespace binrig {

/// What draws like those of simulated recordings explain of a residual.
///
/// Model: the cosines of a capture's bias map are independent and normal, with the variance of the rung's own
/// randomness plus a strength times that of the simulated draws, one in each ring of frequency (Whittle). A step or a
/// bend has much in a few cosines and nothing in the others: squares count up to nine times what is expected, and where
/// a ring has four times more than the draws would, it is not alike. Slow rings may have less: a fit takes more of them
/// than nuisances about it do. The finer half of the draws' power must be there, at least a fourth of it. Nor is it
/// alike where captures have it in common: two draws go together by chance alone.
class DrawnMap {
 public:
  struct Gain {
    double train = 0,
           test = 0;      ///< twice the logarithm of the likelihood's ratio, at the strength that is best on train
    double strength = 0;  ///< of the draws' variance, over that of the simulated ones; 0 if nothing is explained
    bool alike = false;   ///< no ring has far more than the draws would, and captures have little in common
  };

  /// `without`: simulations of the rung's model; `with`: of the model with the effect, same trials, all captures.
  DrawnMap(const Layout& layout, const Rung& rung, const std::vector<StatVector>& without,
           const std::vector<StatVector>& with);

  /// `train`, `test`: Explained::rest of either part.
  Gain gain(const Whitened& train, const Whitened& test) const;

 private:
  struct Capture {
    int offset, cells, cols;
    bool train;
    std::vector<double> noise, drawn;  ///< mean squares of the cosines, by ring
  };
  double gain_of(bool train, const std::vector<RingSquares>& squares, double strength) const;
  bool looks_alike(const std::vector<RingSquares>& squares, double strength) const;
  /// Mean correlation of two captures' residuals, the rung's own randomness taken out of their power; about 0 of draws,
  /// about 1 of what is the same in all. 0 if less than two captures have more than that randomness.
  double in_common(const Whitened& train, const Whitened& test) const;

  std::vector<Capture> captures_;
};

}  // namespace binrig
