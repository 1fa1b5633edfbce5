// Coherent noise: random fields that vary smoothly over the image, for thresholds that are not the same everywhere.
//
// Gradient noise on a lattice (Perlin, "An image synthesizer", SIGGRAPH 1985), mixed from several lattice sizes as the
// thesis does in 5.3.7 (its equations 11 to 19), with the cubic weight 3t^2 - 2t^3; the quintic 6t^5 - 15t^4 + 10t^3
// (Perlin, "Improving noise", SIGGRAPH 2002) is the option without creases in the second derivative.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/random.h"

namespace binrig {

enum class LatticeWeight { cubic, quintic };

/// A field of mean 0 and standard deviation 1 (over places and draws).
///
/// We deviate from Perlin: gradients point in any direction (no table), and each draw shifts its lattices by a random
/// part of a cell, since gradient noise is 0 at every lattice point and would otherwise leave the same grid of
/// undisturbed pixels in every frame. The lattices of size g, g/2, g/4 have weights 1, 1/2, 1/4.
class CoherentNoise {
 public:
  /// grid_px >= 4: the coarsest lattice's cell. Throws Error if it is smaller or the size is not positive.
  CoherentNoise(int rows, int cols, double grid_px, LatticeWeight weight = LatticeWeight::cubic);

  /// rows x cols, CV_32F. Same stream, same bytes.
  void draw(const RandomStream& stream, cv::Mat& field) const;
  /// The same, kept by recent_field: must not be written to.
  cv::Mat recent(const RandomStream& stream) const;
  /// No value of any draw is further from 0.
  double bound() const;

 private:
  struct Lattice {
    double cell_px;
    float scale;  ///< to the share of this lattice in a unit variance
  };
  void add(const Lattice& lattice, const RandomStream& stream, cv::Mat& field) const;

  int rows_, cols_;
  double grid_px_;
  LatticeWeight weight_;
  std::vector<Lattice> lattices_;
};

/// Mean square of gradient noise with unit gradients, over a cell: 4 A B with A = int w^2, B = int w^2 t^2 over 0..1.
double gradient_noise_variance(LatticeWeight weight);

/// The field of a disturbed threshold: unit standard deviation, of whose variance the share `changing` is new in every
/// frame and the rest stays through a capture.
class DisturbanceField {
 public:
  DisturbanceField(int rows, int cols, double grid_px, double changing, LatticeWeight weight,
                   const RandomStream& capture_draws);
  /// Must not be written to.
  cv::Mat at(const RandomStream& frame_draws) const;
  /// No value of the field is further from 0: a threshold that nothing comes so near to needs no field.
  double bound() const;

 private:
  CoherentNoise noise_;
  double changing_;
  RandomStream capture_draws_;
};

}  // namespace binrig
