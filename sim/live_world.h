// A world in which things happen: one per cell, shared by its sources and its bins. What a bin does, the next frame of
// every camera shows.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/bin.h"
#include "sim/stacking.h"
#include "sim/world.h"

namespace binrig {

/// Thread-safe: commands wait for each other, now() never waits for a pile to settle.
class LiveWorld {
 public:
  /// Drops what the world's bins are filled with (scene 0). Throws Error if that cannot be done.
  LiveWorld(World world, std::uint64_t seed);
  ~LiveWorld();

  /// The world at this moment, piles frozen: objects where they lie, bins as they lean, lamps as they are switched.
  std::shared_ptr<const World> now() const;

  /// Empties the bins and drops a pile of its own for every (seed, scene), whatever came before.
  void begin_scene(int scene);

  int bins() const;
  BinState bin_state(int bin) const;
  /// Returns when the pile lies still (or the time limit has passed: then bin_state().fault is `fault_not_steady`).
  void command(int bin, const BinCommand& command);

  /// Takes now()->objects[object] out of its bin; what lay on it moves. False for one that lies in no bin.
  bool pick(std::size_t object);

  /// Of the bin's last command, or of the drop of its scene.
  SettleReport last_settle(int bin) const;
  int picked(int bin) const;  ///< since the last refill

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

inline constexpr int fault_not_steady = 1;

/// The bin of a live world. Tilt turns it about its x axis; the clamp holds bin and parts together, so that neither
/// shaking nor tilting moves a part in it; refill 0 brings the pile back to as many parts as at first.
std::unique_ptr<Bin> make_simulated_bin(std::shared_ptr<LiveWorld> world, int bin = 0);

}  // namespace binrig
