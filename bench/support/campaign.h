// Campaigns of known targets: which target stands where in each capture, and sets on disk that hold poses, times and
// meshes but no depth yet, for a forward model to fill. Benchmarks and fixtures are made from them.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/recording_set.h"
#include "sim/mesh.h"

namespace binrig::bench {

struct CampaignModel {
  std::shared_ptr<const Mesh> mesh;
  Surface surface;
};

struct PlacedModel {
  int obj_id = 0;  ///< index into models, counting from 1
  Pose X_CO = Pose::Identity();
};

struct CampaignCapture {
  CaptureInfo info;
  std::vector<PlacedModel> objects;  ///< at the first frame
  double frame_interval_s = 1.0 / 3;
  Vector3 velocity_mm_s = Vector3::Zero();  ///< of all objects, camera frame
};

/// Board, step, ball, groove, chart and bin, and the captures made of them. Lengths in mm, angles in rad, camera frame.
class Campaign {
 public:
  explicit Campaign(std::uint64_t seed);
  const std::vector<CampaignModel>& models() const { return models_; }
  const std::vector<CampaignCapture>& captures() const { return captures_; }

  /// A capture's id counts within its split. Returned so that the caller may change it.
  CampaignCapture& capture(const char* split, const char* name, std::vector<PlacedModel> objects, int frames,
                           TargetKind kind = TargetKind::scene);
  CampaignCapture& plane(const char* split, const char* name, int frames, double z, double rx = 0, double ry = 0);
  /// A series from power-on, on a plane that faces the camera.
  CampaignCapture& warm_up(const char* split, const char* name, int frames, double z, double frame_interval_s);

  /// A box on the board, 90 mm high, turned about the optical axis.
  std::vector<PlacedModel> step(double x, double y, double z, double turn) const;
  std::vector<PlacedModel> ball(double x, double y, double z) const;
  /// Two panels that meet in a line `z` away, each turned by `angle` towards the camera.
  std::vector<PlacedModel> groove(double z, double angle, double turn) const;
  /// Twelve tiles of different albedo, two of them shiny.
  std::vector<PlacedModel> chart(double z) const;
  /// Parts laid loosely into a box of four walls: nothing stands on nothing, but nobody shook it either.
  std::vector<PlacedModel> bin(std::uint64_t which) const;

 private:
  template <typename Make>
  int add(Make make, const Surface& surface);
  std::uint64_t seed_;
  std::vector<CampaignModel> models_;
  std::vector<CampaignCapture> captures_;
  int board_, step_, ball_, panel_, wall_;
  std::vector<int> tiles_, parts_;
};

/// A set with headers, meshes and frames without depth. `info` gives everything but the captures.
void write_nominal(const std::string& path, const SetInfo& info, const Camera& camera, double depth_scale_mm,
                   const std::vector<CampaignModel>& models, const std::vector<CampaignCapture>& captures);

/// The active-stereo sensor of the campaigns: projector 100 mm beside the camera, 700 .. 900 mm, poses known to
/// 0.15 mm and 3e-4 rad.
SetInfo campaign_sensor();

}  // namespace binrig::bench
