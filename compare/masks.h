// Which pixels are missing, and does the model say why? Predicted against measured missing pixels, by predicted reason.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/frame.h"

namespace binrig {

/// Counts in blocks of the image, so that intervals respect that missing pixels come in patches.
class MaskTally {
 public:
  static constexpr int block_px = 48;
  /// Of one frame. `counted`: CV_8U, not 0 where the scene has a surface and the recording speaks (valid_region).
  /// Throws Error if sizes differ.
  void add(const cv::Mat& measured_reason, const cv::Mat& predicted_reason, const cv::Mat& counted);

  struct Block {
    double pixels = 0, missing = 0;                       ///< counted; of them measured as missing
    std::array<double, reason_count> predicted{}, hit{};  ///< predicted missing for a reason; of them really missing
  };
  const std::vector<Block>& blocks() const { return blocks_; }

 private:
  std::vector<Block> blocks_;
};

/// A share with its 95 % interval.
struct ShareInterval {
  double value = 0, low = 0, high = 1;
};

struct ReasonScore {
  Reason reason = Reason::unknown;
  double predicted_share = 0;  ///< of the counted pixels
  ShareInterval precision;     ///< of the pixels predicted missing for this reason, the share that is missing
  ShareInterval recall;        ///< of the missing pixels, the share that is predicted missing for this reason
  ShareInterval iou;           ///< both over either
};

struct MaskScore {
  std::string model;  ///< "perfect depth", "all effects"
  double pixels = 0;
  double missing_share = 0, predicted_share = 0;
  ShareInterval precision, recall, iou;  ///< whatever the reason
  ShareInterval unexplained;             ///< missing pixels that no reason explains: 1 - recall
  std::vector<ReasonScore> by_reason;    ///< reasons that were predicted at all
};

/// Scores of pooled tallies (captures, frames). Intervals: 1,000 draws of whole blocks with replacement (block
/// bootstrap: Kuensch 1989), 2.5 % and 97.5 % points. Same seed, same numbers. Where a share has no denominator it is 0
/// in 0 .. 1.
MaskScore mask_score(const std::string& model, const std::vector<const MaskTally*>& tallies, std::uint64_t seed);

/// A map of what came true: 0 not counted, 1 both measured, 2 both missing, 3 missing and not predicted, 4 predicted
/// and not missing. CV_8U.
cv::Mat outcome_map(const cv::Mat& measured_reason, const cv::Mat& predicted_reason, const cv::Mat& counted);

}  // namespace binrig
