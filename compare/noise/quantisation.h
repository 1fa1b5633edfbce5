// In which steps does the depth come? Found from the values alone.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace binrig {

struct QuantisationStep {
  bool found = false;          ///< a comb coarser than the storage step
  double storage_step_mm = 0;  ///< what the file says; 0 = depth is not stored in steps
  double step_mm = 0;          ///< at `depth_mm`; the storage step where nothing coarser is found
  double depth_mm = 0;         ///< middle of the depths seen
  /// The step grows with depth to this power: 0 = steps of depth, 2 = steps of disparity (1: between).
  int power = 0;
  double coherence = 0;  ///< 1 = every value lies on the comb; expected for rounding to the storage step: sinc
  double p_value = 1;    ///< Rayleigh's test that the values do not know the comb
  int levels = 0;        ///< different values seen
};

/// Counts how often each stored value occurs.
class ValueLevels {
 public:
  /// Only pixels with valid != 0. A frame without storage steps is not counted.
  void add(const cv::Mat& depth_mm, const cv::Mat& valid, double depth_scale_mm);
  /// Levels between the 1 % and 99 % quantile of the values. The gaps between successive levels give a first guess; the
  /// comb is where the levels' phases agree best, among steps proportional to z^0, z^1, z^2. A step must be coarser
  /// than 1.5 storage steps, have at least 8 levels and a coherence above 0.5.
  QuantisationStep finish() const;

 private:
  double scale_ = 0;
  std::vector<std::uint64_t> counts_;
};

}  // namespace binrig
