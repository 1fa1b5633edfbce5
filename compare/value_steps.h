// Steps in which recorded values come, read off the values themselves.
//
// Where depth (or disparity) is rounded to whole steps, the characteristic function of its values has a line at one
// cycle per step, whatever the scene: Kendall's quantogram (D. G. Kendall, Hunting quanta, Phil. Trans. R. Soc. A 276,
// 1974). His is of cosines; here it is the modulus, so that all steps may share an offset, and lines are held against
// those of values in which no step is expected: flat targets are seen at few levels anyway. A line is no proof: each is
// a value to try. (What step one plane's values show without a model, noise/quantisation.h says.)
#pragma once

#include <cstdint>
#include <vector>

#include "core/frame.h"

namespace binrig {

/// A step that values seem to come in; both numbers in the values' unit, mm or px.
struct ReadStep {
  double value = 0;
  /// Surely nearer than this: so far off, the typical (mean) value would lie between two whole multiples where it lies
  /// on one, value^2 / (2 mean). What is read is some ten times nearer.
  double uncertainty = 0;
  /// Nearly all values lie on its whole multiples: the mean of cos(2 pi x / value) over all values x is beyond 0.9.
  bool exact = false;
};

/// Counts the values of a recording up to 5.2 m and 512 px (6 MB; memory does not grow with the number of frames).
class ValueSteps {
 public:
  ValueSteps();

  /// Valid pixels (depth > 0) of a frame of any size; with them the step in which it stores depth, the coarsest of all
  /// frames. `focal_baseline`: f * B in px mm; 0 = unknown, no disparity. Not thread-safe.
  void add(const Frame& frame, double focal_baseline);

  /// Steps (mm, px) between `finest` and `coarsest` whose lines are strongest, or stand out most from their
  /// neighbourhood, in turn, at most `most`; a line at a multiple of another's frequency is not listed beside it, nor
  /// one of which `usual` values of the same targets have the like at about that frequency. Where all values meet zero
  /// as well, the step is the one whose whole multiples they are. Empty where nothing stands out. Precondition: 0 <
  /// finest < coarsest. On values stored in whole steps s, lines at f and 1/s - f are the same one: where it is as weak
  /// as that of a step finer than 2 s, depth_mm lists both steps (`most` counts lines); none is finer than s.
  std::vector<ReadStep> depth_mm(double finest, double coarsest, int most, const ValueSteps& usual) const;
  std::vector<ReadStep> disparity_px(double finest, double coarsest, int most, const ValueSteps& usual) const;

 private:
  std::vector<std::uint32_t> depth_, disparity_;
  double storage_mm_ = 0;  // 0 = unknown
};

}  // namespace binrig
