// The experiment: the captures of a recording set, read as one long vector of statistics, measured or simulated.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "compare/statistic.h"
#include "core/forward_model.h"
#include "diagnose/cache.h"

namespace binrig {

/// Stabilised statistics of all captures; NaN = unknown (the only place where NaN means something).
using StatVector = std::vector<float>;

/// One segment of one capture in the vector.
struct Block {
  int capture = 0, segment = 0;
  int offset = 0, size = 0;
  int rows = 1, cols = 0;  ///< of a map
  bool train = true;
};

struct Layout {
  std::vector<Block> blocks;
  int size = 0;
  int captures = 0;
  std::vector<bool> train;  ///< by capture
  /// The block of a capture's segment, or null.
  const Block* find(int capture, const std::string& segment_name) const;
};

/// Fills what some of several simulations (or differences) do not know with the mean of those that do. `by_block`: what
/// none knows, too, with the mean of its block in the image, if any of that is known.
void fill_unknown(const Layout& layout, std::vector<StatVector>& simulations, bool by_block = false);

/// Captures of which two simulations do not say the same.
std::vector<int> captures_that_differ(const Layout& layout, const StatVector& a, const StatVector& b);

/// Which captures take part.
enum class Part { all, train, test };

/// What was measured: statistics of all frames, and of as many as shortened simulations have. Many statistics depend on
/// the number of frames in their mean (the logarithm of a variance, the modulus of a mean), so that simulations are
/// only ever compared with as many measured frames.
struct Measurement {
  StatVector all;
  std::map<std::pair<int, bool>, StatVector> few;  ///< by Trial's most_frames and shorten_series
  const StatVector& at(int most_frames, bool shorten_series) const {
    return most_frames == 0 ? all : few.at({most_frames, shorten_series});
  }
};

/// The course of a series from power-on, of a motion or of repeats does not show in a few frames: with effects that
/// have such a need, Trial::shorten_series would hide them.
inline bool needs_whole_series(const Needs& needs) { return needs.power_on || needs.repeats || needs.motion; }

/// One simulation of the set.
struct Trial {
  SensorModel model;
  std::vector<Offset> offsets;  ///< by capture; empty = nominal
  std::uint64_t seed = 1;
  Part part = Part::all;
  /// No more than this many frames of a capture, unless it is a series from power-on. 0 = all.
  int most_frames = 0;
  bool shorten_series = false;  ///< series from power-on, too
  std::vector<int> only;        ///< these captures; empty = all of `part`
};

class Experiment {
 public:
  /// All captures that `forward` can simulate. `model` says where camera and projector are. Throws Error if there are
  /// none. All three must outlive the experiment.
  Experiment(const ForwardModel& forward, const SensorModel& model, SimulationCache& cache);
  ~Experiment();

  const ForwardModel& forward() const { return forward_; }
  const Layout& layout() const { return layout_; }
  const std::vector<CaptureInfo>& captures() const { return forward_.captures(); }
  const StatisticContext& context(int capture) const { return contexts_[capture]; }
  /// Perfect channels of the nominal scene (first frame): what the statistics read.
  const Channels& nominal(int capture) const { return *nominal_[capture]; }
  /// The same of another frame: what the statistics read it by. One object for all frames of a scene that stands still.
  std::shared_ptr<const Channels> nominal_at(int capture, int frame) const;
  std::shared_ptr<const CaptureRegions> regions(int capture) const { return regions_[capture]; }
  bool repeats() const;

  using FrameReader = std::function<Frame(int capture, int frame)>;
  /// Statistics of measured frames, also of no more than `shortened` of them. A frame that cannot be read is left out
  /// and named in `unreadable`.
  Measurement measure(const FrameReader& reader, std::vector<std::string>& unreadable,
                      const std::vector<int>& shortened = {2, 3}) const;

  /// Statistics of simulated recordings, in parallel over captures. Same trial, same bytes; kept in the cache.
  /// `shared`: the trials do not depend on what was measured.
  std::vector<StatVector> simulate(const std::vector<Trial>& trials, const std::string& progress = "",
                                   bool shared = false) const;

  /// Statistics of no more than `frames` frames of a capture whose target stood, and was known to stand, at an offset
  /// from where it was recorded; NaN in the rest of the vector. Not cached. Throws what simulating throws.
  StatVector elsewhere(const SensorModel& model, int capture, const Offset& where, std::uint64_t seed,
                       int frames) const;

  /// Number of capture simulations that were really made (not found in the cache).
  long simulated() const { return simulated_; }

 private:
  void put(int capture, const std::vector<RawStatistic>& raw, StatVector& vector) const;
  void simulate_capture(const Trial& trial, int capture, StatVector& vector) const;
  using SeenAt = std::function<std::shared_ptr<const Channels>(int frame)>;
  /// Simulates so many frames and writes their statistics, relative to what is `seen`, to the capture's blocks.
  void read_simulation(SimulationRequest request, int frames, const SeenAt& seen, StatVector& vector) const;
  void account(const std::string& what, const Trial& trial, int capture, double cpu_s) const;

  const ForwardModel& forward_;
  SensorModel base_;
  SimulationCache& cache_;
  Layout layout_;
  std::vector<StatisticContext> contexts_;
  std::vector<std::shared_ptr<const Channels>> nominal_;
  std::vector<std::shared_ptr<const CaptureRegions>> regions_;
  std::uint64_t set_key_ = 0;
  mutable std::atomic<long> simulated_{0};
  /// What simulating cost, by what it was for; printed at the end where tracing() is on.
  struct Cost {
    long captures = 0, frames = 0;
    double cpu_s = 0;
  };
  mutable std::map<std::string, Cost> costs_;
  mutable std::mutex costs_guard_;
};

}  // namespace binrig
