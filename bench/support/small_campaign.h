// The small campaign that coverage and hidden-effect studies run on: 128 x 96 px, 23 captures, and the draws by which
// one recording of it differs from the next.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "bench/support/campaign.h"
#include "core/sensor_model.h"
#include "sim/scene_forward_model.h"

namespace binrig::bench {

/// Planes at three distances, tilts, step, sphere, groove, reflectance chart, bin of parts, a plane that comes nearer
/// and a series from power-on in train; other distances and other targets in test. Poses, times and meshes are written
/// to a scratch folder, which goes with the object; depth images are made in memory.
class SmallCampaign {
 public:
  /// `quick`: the fewest captures that still show most effects, for tests.
  explicit SmallCampaign(bool quick = false);
  /// Other captures of such targets, by the same camera or one with more pixels (a multiple of 4 across, 4 : 3).
  explicit SmallCampaign(const Campaign& campaign, int width = 128);
  ~SmallCampaign();
  SmallCampaign(const SmallCampaign&) = delete;
  SmallCampaign& operator=(const SmallCampaign&) = delete;
  const SceneForwardModel& forward() const { return *forward_; }

 private:
  std::filesystem::path folder_;
  std::unique_ptr<SceneForwardModel> forward_;
};

/// models/thesis-five.yaml: the model that a diagnosis starts from.
SensorModel five_effect_model();

/// The same model with its parameters drawn at random within what instruments show, unit seed included: what the
/// instrument really is.
SensorModel drawn_five_effect_model(std::uint64_t seed);

/// Where the targets really stood (pose_sigma, one draw a capture) and what the lens really was (cam_K_sigma_px, one
/// draw for all).
std::vector<Offset> drawn_offsets(const ForwardModel& forward, std::uint64_t seed);

/// Frames of all captures, by capture and frame.
using Recording = std::vector<std::vector<Frame>>;

/// What the catalogue's own effects make of the campaign. For hidden effects see bench/hidden_effects, whose data
/// shares no code with the catalogue.
Recording simulated_recording(const ForwardModel& forward, const SensorModel& model, const std::vector<Offset>& offsets,
                              std::uint64_t seed);

}  // namespace binrig::bench
