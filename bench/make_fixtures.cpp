// Writes fixtures/recorded: campaigns "recorded" by sensors whose truth is documented (fixtures/recorded/README.md).
//
//   make_fixtures OUT SENSORS
//
// OUT must not exist. Poses in the files are nominal; every capture's targets really stood elsewhere, within
// pose_sigma.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "bench/support/campaign.h"
#include "core/random.h"
#include "core/recording_writer.h"
#include "sim/effect.h"
#include "sim/scene_forward_model.h"

namespace binrig::bench {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t seed = 20241121;
constexpr double degree = std::numbers::pi / 180;

Campaign captures() {
  Campaign campaign(seed);
  constexpr int train = 4, test = 3;
  campaign.plane("train", "plane_720", train, 720);
  campaign.plane("train", "plane_800", train, 800);
  campaign.plane("train", "plane_880", train, 880);
  campaign.plane("train", "tilt_y34", train, 800, 0, 34 * degree);
  campaign.plane("train", "tilt_x40", train, 800, 40 * degree, 0);
  campaign.capture("train", "step", campaign.step(-12, 6, 850, 12 * degree), train);
  campaign.capture("train", "sphere", campaign.ball(8, -5, 790), train);
  campaign.capture("train", "chart", campaign.chart(800), train);
  campaign.capture("train", "groove", campaign.groove(850, 38 * degree, 8 * degree), train);
  campaign.capture("train", "bin", campaign.bin(1), train);
  campaign.warm_up("train", "warm_up", 10, 800, 10);
  campaign.plane("test", "plane_750", test, 750);
  campaign.plane("test", "plane_850", test, 850);
  campaign.plane("test", "tilt_xy", test, 800, 22 * degree, -20 * degree);
  campaign.capture("test", "step_2", campaign.step(20, -8, 830, -25 * degree), test);
  campaign.capture("test", "sphere_2", campaign.ball(-20, 10, 770), test);
  campaign.capture("test", "groove_2", campaign.groove(830, 30 * degree, 80 * degree), test);
  campaign.capture("test", "bin_2", campaign.bin(2), test);
  campaign.warm_up("test", "warm_up_2", 6, 760, 10);
  campaign.capture("test", "chart_2", campaign.chart(760), test);
  return campaign;
}

Campaign plane_source_captures() {
  Campaign campaign(seed);
  campaign.plane("train", "plane_740", 8, 740);
  campaign.plane("train", "plane_860", 8, 860);
  campaign.plane("test", "plane_800", 8, 800);
  return campaign;
}

// What the sensor makes of it, every capture's targets moved by its own draw from pose_sigma.
void record(const std::string& nominal_path, const SensorModel& model, const std::string& out) {
  const RecordingSet nominal = RecordingSet::open(nominal_path);
  const SceneForwardModel forward(nominal);
  const SetInfo& set = nominal.info();
  RecordingWriter writer(out, nominal.info());
  for (std::size_t c = 0; c < forward.captures().size(); ++c) {
    const CaptureInfo& info = forward.captures()[c];
    SimulationRequest request;
    request.capture = static_cast<int>(c);
    request.model = &model;
    request.seed = mix_keys(seed, hash_text(model.name));
    const RandomStream draws = RandomStream(request.seed).child("poses").child(info.key());
    for (int i = 0; i < 6; ++i)
      request.offset.pose[i] = (i < 3 ? *set.pose_sigma_rad : *set.pose_sigma_mm) * draws.normal(i);
    writer.begin_capture(info);
    forward.simulate(request, [&](const Frame& frame, int) { writer.write(frame); });
    writer.finish_capture();
    std::printf("%s %s\n", out.c_str(), info.key().c_str());
  }
  writer.copy_models(nominal_path);
}

void make(const fs::path& out, const fs::path& sensors) {
  if (fs::exists(out)) throw Error(out.string() + " exists already");
  SetInfo info = campaign_sensor();
  info.sensor.name = "first-principles instrument";
  info.sensor.principle = "structured light";

  const Campaign campaign = captures();
  const fs::path scratch = out / "nominal";
  const Camera camera = camera_from_field_of_view(160, 120, 16.06 * degree);
  info.valid_region = cv::Mat::zeros(camera.height, camera.width, CV_8U);  // where the matching window fits in
  info.valid_region(cv::Rect(1, 1, camera.width - 2, camera.height - 2)) = 255;
  write_nominal(scratch / "campaign", info, camera, 0.02, campaign.models(), campaign.captures());
  for (const char* name : {"clean", "imperfect"}) {
    const SensorModel model = read_sensor_model(sensors / fmt::format("{}.yaml", name), effect_catalogue());
    record(scratch / "campaign", model, out / fmt::format("campaign-{}", name));
  }

  info.sensor.name = "planes with noise of a known spectrum";
  info.cam_K_sigma_px.reset();
  info.valid_region.release();
  const Campaign planes = plane_source_captures();
  write_nominal(scratch / "planes", info, camera.resized(320, 240), 0.02, {planes.models().front()}, planes.captures());
  record(scratch / "planes", read_sensor_model(sensors / "plane_source.yaml", effect_catalogue()),
         out / "plane-source");
  fs::remove_all(scratch);
}

}  // namespace
}  // namespace binrig::bench

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: make_fixtures OUT SENSORS\n");
    return 2;
  }
  try {
    binrig::bench::make(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
