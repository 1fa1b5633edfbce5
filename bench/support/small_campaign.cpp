#include "bench/support/small_campaign.h"

#include <unistd.h>

#include <numbers>

#include "core/random.h"
#include "sim/effect.h"

namespace binrig::bench {
namespace {

constexpr double degree = std::numbers::pi / 180;
constexpr std::uint64_t bins_seed = 20251121;

Campaign small_captures() {
  Campaign campaign(bins_seed);
  constexpr int frames = 4;
  campaign.plane("train", "plane_720", frames, 720);
  campaign.plane("train", "plane_800", frames, 800);
  campaign.plane("train", "plane_880", frames, 880);
  campaign.plane("train", "tilt_y42", frames, 800, 0, 42 * degree);
  campaign.plane("train", "tilt_x52", frames, 800, 52 * degree, 0);
  campaign.capture("train", "step", campaign.step(-12, 6, 850, 12 * degree), frames);
  campaign.capture("train", "step_turned", campaign.step(8, -10, 800, 95 * degree), frames);
  campaign.capture("train", "sphere", campaign.ball(8, -5, 790), frames);
  campaign.capture("train", "chart", campaign.chart(800), frames);
  campaign.capture("train", "groove", campaign.groove(850, 38 * degree, 8 * degree), frames);
  campaign.capture("train", "bin", campaign.bin(1), frames);
  campaign.plane("train", "coming", 6, 840, 10 * degree, -15 * degree).velocity_mm_s = Vector3(0, 0, -30);
  campaign.warm_up("train", "warm_up", 20, 800, 6);
  campaign.plane("test", "plane_750", frames, 750);
  campaign.plane("test", "plane_850", frames, 850);
  campaign.plane("test", "tilt_xy", frames, 800, 32 * degree, -38 * degree);
  campaign.capture("test", "step_2", campaign.step(20, -8, 830, -25 * degree), frames);
  campaign.capture("test", "sphere_2", campaign.ball(-20, 10, 770), frames);
  campaign.capture("test", "chart_2", campaign.chart(760), frames);
  campaign.capture("test", "groove_2", campaign.groove(830, 30 * degree, 80 * degree), frames);
  campaign.capture("test", "bin_2", campaign.bin(2), frames);
  campaign.capture("test", "going", campaign.step(-30, 4, 780, 20 * degree), 6).velocity_mm_s = Vector3(10, 0, 25);
  campaign.warm_up("test", "warm_up_2", 16, 760, 6);
  return campaign;
}

Campaign quick_captures() {
  Campaign campaign(bins_seed);
  constexpr int frames = 3;
  campaign.plane("train", "plane_720", frames, 720);
  campaign.plane("train", "plane_880", frames, 880);
  campaign.plane("train", "tilt", frames, 800, 20 * degree, 38 * degree);
  campaign.capture("train", "step", campaign.step(-12, 6, 850, 12 * degree), frames);
  campaign.capture("train", "chart", campaign.chart(800), frames);
  campaign.plane("test", "plane_800", frames, 800);
  campaign.plane("test", "tilt_2", frames, 780, 42 * degree, -15 * degree);
  campaign.capture("test", "step_2", campaign.step(20, -8, 830, 75 * degree), frames);
  campaign.capture("test", "chart_2", campaign.chart(760), frames);
  return campaign;
}

}  // namespace

SmallCampaign::SmallCampaign(bool quick) : SmallCampaign(quick ? quick_captures() : small_captures()) {}

SmallCampaign::SmallCampaign(const Campaign& campaign, int width) {
  std::string name = (std::filesystem::temp_directory_path() / "small-campaign-XXXXXX").string();
  if (!mkdtemp(name.data())) throw Error("no scratch folder can be made at " + name);
  folder_ = name;
  SetInfo info = campaign_sensor();
  info.sensor.name = "small campaign";
  write_nominal(folder_ / "set", info, camera_from_field_of_view(width, width * 3 / 4, 16.06 * degree), 0.02,
                campaign.models(), campaign.captures());
  forward_ = std::make_unique<SceneForwardModel>(RecordingSet::open(folder_ / "set"));
}

SmallCampaign::~SmallCampaign() {
  forward_.reset();
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

SensorModel five_effect_model() {
  return read_sensor_model(BINRIG_SOURCE_DIR "/models/thesis-five.yaml", effect_catalogue());
}

SensorModel drawn_five_effect_model(std::uint64_t seed) {
  SensorModel model = five_effect_model();
  model.name = "instrument";
  const RandomStream draws = RandomStream(seed).child("instrument");
  std::uint64_t index = 0;
  const auto draw = [&](const char* effect, const char* parameter, double low, double high) {
    for (EffectInstance& instance : model.effects)
      if (instance.effect == effect) instance.values[parameter].value = low + (high - low) * draws.uniform(index++);
  };
  draw("projector_shadow", "bias", 0.4, 2.5);
  draw("specular_saturation", "threshold", 0.4, 0.8);
  draw("specular_saturation", "disturbance", 0.03, 0.1);
  draw("low_confidence", "threshold", 64, 78);
  draw("low_confidence", "disturbance", 0.5, 2.5);
  draw("spectral_noise", "sigma", 0.15, 0.4);
  draw("spectral_noise", "correlation_length", 0.5, 1.4);
  draw("spectral_noise", "white_share", 0.05, 0.3);
  draw("bilateral_blur", "sigma_px", 0.4, 0.9);
  draw("bilateral_blur", "sigma_z", 1, 4);
  model.unit_seed = draws.bits(index);
  return model;
}

std::vector<Offset> drawn_offsets(const ForwardModel& forward, std::uint64_t seed) {
  const SetInfo& set = forward.set();
  const RandomStream draws = RandomStream(seed).child("registration");
  std::vector<Offset> offsets(forward.captures().size());
  for (std::size_t c = 0; c < offsets.size(); ++c) {
    const RandomStream own = draws.child(forward.captures()[c].key());
    for (int i = 0; i < 6; ++i)
      offsets[c].pose[i] = (i < 3 ? set.pose_sigma_rad.value_or(0) : set.pose_sigma_mm.value_or(0)) * own.normal(i);
    if (!set.cam_K_sigma_px) continue;
    offsets[c].focal_px = (*set.cam_K_sigma_px)[0] * draws.normal(0);
    offsets[c].cx_px = (*set.cam_K_sigma_px)[1] * draws.normal(1);
    offsets[c].cy_px = (*set.cam_K_sigma_px)[2] * draws.normal(2);
  }
  return offsets;
}

Recording simulated_recording(const ForwardModel& forward, const SensorModel& model, const std::vector<Offset>& offsets,
                              std::uint64_t seed) {
  Recording recording(forward.captures().size());
  for (std::size_t c = 0; c < recording.size(); ++c) {
    SimulationRequest request;
    request.capture = static_cast<int>(c);
    request.model = &model;
    request.offset = offsets[c];
    request.seed = seed;
    forward.simulate(request, [&](const Frame& frame, int) { recording[c].push_back(frame); });
  }
  return recording;
}

}  // namespace binrig::bench
