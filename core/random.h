// Random draws without state: every number is a function of its key and its index.
//
// A stream is keyed by (seed, capture, frame, effect instance), so that adding an effect, a capture or a thread changes
// no other draw, and a pixel's number does not depend on the order in which pixels are visited. Same key, same bytes.
// The generator is Philox-4x32-10 (Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011).
#pragma once

#include <cstdint>
#include <string_view>

#include <opencv2/core/mat.hpp>

namespace binrig {

/// 64-bit FNV-1a; the key of names (capture "train/1", instance "spectral_noise").
std::uint64_t hash_text(std::string_view text, std::uint64_t basis = 14695981039346656037ull);
/// Mixes two keys into one; not symmetric.
std::uint64_t mix_keys(std::uint64_t a, std::uint64_t b);

class RandomStream {
 public:
  explicit RandomStream(std::uint64_t key) : key_(key) {}

  /// A stream of its own for every tag: the same tag gives the same stream.
  RandomStream child(std::uint64_t tag) const { return RandomStream(mix_keys(key_, tag)); }
  RandomStream child(std::string_view tag) const { return child(hash_text(tag)); }

  std::uint64_t bits(std::uint64_t index) const;
  /// In [0, 1), 53 bits.
  double uniform(std::uint64_t index) const;
  /// Standard normal (Box-Muller on one Philox block).
  double normal(std::uint64_t index) const;

  /// Whole images at once (CV_32F, allocated by the caller): element i is a function of (key, i) alone. The float
  /// pictures use the same generator but draw two (normal) or four (uniform) numbers a block: they are not the
  /// values of normal(i) and uniform(i).
  void fill_normal(cv::Mat& image) const;
  void fill_uniform(cv::Mat& image) const;

  std::uint64_t key() const { return key_; }

 private:
  std::uint64_t key_;
};

/// The keys of DESIGN.md. frame < 0 means "fixed through the capture".
RandomStream frame_stream(std::uint64_t seed, std::uint64_t capture_key, std::int64_t frame, std::string_view instance);
/// Maps that belong to a unit (dead pixels, fixed pattern).
RandomStream unit_stream(std::uint64_t unit_seed, std::string_view instance);

}  // namespace binrig
