#include "sim/live_world.h"

#include <algorithm>
#include <chrono>
#include <mutex>

#include "core/error.h"
#include "core/parallel.h"
#include "sim/world_physics.h"

namespace binrig {
namespace {

// What still comes through the windows when the lamps are off.
constexpr float dark_ambient_share = 0.1f;

struct LiveBin {
  std::vector<Body> bodies;  ///< of the parts that fall into this bin
  std::vector<int> part;     ///< their indices into World::parts
  std::vector<int> first;    ///< kinds as dropped at first
  std::unique_ptr<Stacking> stacking;
  SettleReport report;
  bool clamped = false, light_on = true;
  int picked = 0;
};

struct Origin {
  int bin = -1, id = -1;
};

}  // namespace

struct LiveWorld::Impl {
  World world;
  std::uint64_t seed;
  std::vector<LiveBin> bins;
  std::vector<Origin> origins;  ///< of `shown->objects`
  std::shared_ptr<const World> shown;
  int scene = 0;
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  mutable std::mutex acting, showing;

  Impl(World world_, std::uint64_t seed_) : world(std::move(world_)), seed(seed_) {
    for (const WorldBin& bin : world.bins) {
      LiveBin live;
      for (const auto& [part, count] : bin.fill) {
        live.first.insert(live.first.end(), static_cast<std::size_t>(count), static_cast<int>(live.part.size()));
        live.part.push_back(part);
        live.bodies.push_back(body_of(world.parts[static_cast<std::size_t>(part)]));
      }
      bins.push_back(std::move(live));
    }
    fill();
  }

  LiveBin& at(int bin) {
    if (bin < 0 || bin >= static_cast<int>(bins.size())) {
      throw Error("The world " + world.name + " has no bin " + std::to_string(bin) + ".");
    }
    return bins[static_cast<std::size_t>(bin)];
  }

  void fill() {
    parallel_for(static_cast<int>(bins.size()), [&](int i) {
      LiveBin& live = bins[static_cast<std::size_t>(i)];
      const WorldBin& bin = world.bins[static_cast<std::size_t>(i)];
      live.picked = 0;
      live.clamped = false;
      if (live.bodies.empty()) return;
      const RandomStream stream =
          RandomStream(seed)
              .child("stacking")
              .child(bin.name)
              .child(mix_keys(static_cast<std::uint64_t>(i), static_cast<std::uint64_t>(scene)));
      live.stacking = std::make_unique<Stacking>(live.bodies, box_of(bin), world.physics, stream);
      live.report = live.stacking->drop(live.first, bin.layout);
    });
    show();
  }

  void show() {
    auto next = std::make_shared<World>(world);
    std::vector<Origin> from(next->objects.size());
    bool light = true;
    for (std::size_t i = 0; i < bins.size(); ++i) {
      const LiveBin& live = bins[i];
      light = light && live.light_on;
      if (!live.stacking) continue;
      WorldBin& bin = next->bins[i];
      bin.X_WB = bin.X_WB * Eigen::AngleAxisd(live.stacking->tilt_rad(), Vector3::UnitX());
      for (const PlacedPart& placed : live.stacking->parts()) {
        next->objects.push_back({live.part[static_cast<std::size_t>(placed.kind)], bin.X_WB * placed.X_BO});
        from.push_back({static_cast<int>(i), placed.id});
      }
    }
    if (!light) {
      next->lights.clear();
      next->ambient *= dark_ambient_share;
    }
    const std::lock_guard lock(showing);
    origins = std::move(from);
    shown = std::move(next);
  }

  void refill(int index, double value) {
    LiveBin& live = at(index);
    const WorldBin& bin = world.bins[static_cast<std::size_t>(index)];
    if (!(value >= 0 && value <= 1000) || value != static_cast<int>(value)) {
      throw Error("cannot refill the bin",
                  {{"", "refill", number_text(value), "parts", "0 .. 1000", "is no number of parts"}});
    }
    std::vector<int> kinds;
    if (value == 0) {
      kinds = live.first;
      for (const PlacedPart& part : live.stacking->parts()) {
        const auto here = std::find(kinds.begin(), kinds.end(), part.kind);
        if (here != kinds.end()) kinds.erase(here);
      }
    } else {
      for (int i = 0; i < static_cast<int>(value); ++i) {
        kinds.push_back(live.first[static_cast<std::size_t>(i) % live.first.size()]);
      }
    }
    live.picked = 0;
    if (!kinds.empty()) live.report = live.stacking->drop(kinds, bin.layout);
  }
};

LiveWorld::LiveWorld(World world, std::uint64_t seed) : impl_(std::make_unique<Impl>(std::move(world), seed)) {}
LiveWorld::~LiveWorld() = default;

std::shared_ptr<const World> LiveWorld::now() const {
  const std::lock_guard lock(impl_->showing);
  return impl_->shown;
}

void LiveWorld::begin_scene(int scene) {
  const std::lock_guard lock(impl_->acting);
  impl_->scene = scene;
  impl_->fill();
}

int LiveWorld::bins() const { return static_cast<int>(impl_->bins.size()); }

BinState LiveWorld::bin_state(int bin) const {
  const std::lock_guard lock(impl_->acting);
  const LiveBin& live = impl_->at(bin);
  BinState state;
  state.time_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - impl_->begin).count();
  state.light_on = live.light_on;
  state.clamped = live.clamped;
  if (live.stacking) {
    state.weight_kg = live.stacking->weight_kg();
    state.part_present = !live.stacking->parts().empty();
    state.tilt_rad = live.stacking->tilt_rad();
    state.fault = live.report.steady ? 0 : fault_not_steady;
  }
  return state;
}

void LiveWorld::command(int bin, const BinCommand& command) {
  const std::lock_guard lock(impl_->acting);
  LiveBin& live = impl_->at(bin);
  using Kind = BinCommand::Kind;
  if (!live.stacking && command.kind != Kind::light && command.kind != Kind::clamp) {
    throw Error("The bin " + impl_->world.bins[static_cast<std::size_t>(bin)].name + " has no parts that could move.");
  }
  switch (command.kind) {
    case Kind::light:
      live.light_on = command.value != 0;
      break;
    case Kind::clamp:
      live.clamped = command.value != 0;
      if (live.stacking) {
        live.stacking->clamp(live.clamped);
        live.report = live.stacking->settle();
      }
      break;
    case Kind::shake:
      live.report = live.stacking->shake(command.value);
      break;
    case Kind::tilt:
      live.report = live.stacking->tilt(command.value);
      break;
    case Kind::refill:
      impl_->refill(bin, command.value);
      break;
  }
  impl_->show();
}

bool LiveWorld::pick(std::size_t object) {
  const std::lock_guard lock(impl_->acting);
  if (object >= impl_->origins.size() || impl_->origins[object].bin < 0) return false;
  const Origin origin = impl_->origins[object];
  LiveBin& live = impl_->at(origin.bin);
  live.stacking->remove(origin.id);
  ++live.picked;
  live.report = live.stacking->settle();
  impl_->show();
  return true;
}

SettleReport LiveWorld::last_settle(int bin) const {
  const std::lock_guard lock(impl_->acting);
  return impl_->at(bin).report;
}

int LiveWorld::picked(int bin) const {
  const std::lock_guard lock(impl_->acting);
  return impl_->at(bin).picked;
}

namespace {

class SimulatedBin : public Bin {
 public:
  SimulatedBin(std::shared_ptr<LiveWorld> world, int bin) : world_(std::move(world)), bin_(bin) {
    world_->bin_state(bin_);  // throws for a bin that is not there
  }
  BinState state() override { return world_->bin_state(bin_); }
  void command(const BinCommand& command) override { world_->command(bin_, command); }

 private:
  std::shared_ptr<LiveWorld> world_;
  int bin_;
};

}  // namespace

std::unique_ptr<Bin> make_simulated_bin(std::shared_ptr<LiveWorld> world, int bin) {
  return std::make_unique<SimulatedBin>(std::move(world), bin);
}

}  // namespace binrig
