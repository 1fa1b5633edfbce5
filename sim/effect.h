// How an effect acts on frames. What it is stands in its declaration (core/effect_declaration.h).
//
// To add one: write sim/effects/NAME.cpp that defines `const Effect& NAME()` in namespace binrig::effects, and its test
// tests/effects/NAME_test.cpp. Nothing else: the build finds it, writes the table, and stops where the test is missing.
#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/channels.h"
#include "core/effect_declaration.h"
#include "core/frame.h"
#include "core/random.h"
#include "core/sensor_model.h"

namespace binrig {

/// A frame under construction; all images have the camera's size. Valid pixel: reason == measured and depth_mm > 0.
/// An effect must never let the depth of an invalid pixel influence a valid one.
struct Layers {
  cv::Mat depth_mm;     ///< CV_32F
  cv::Mat sigma_scale;  ///< CV_32F, factor on the noise's standard deviation; the amplitude stage multiplies it
  cv::Mat noise_mm;     ///< CV_32F, filled in the noise stage, added to the depth at that stage's end
  cv::Mat reason;       ///< CV_8U, values of Reason
  cv::Mat ir;           ///< CV_32F, relative IR intensity (EFFECTS.md), or empty

  bool valid(int row, int col) const {
    return reason.at<std::uint8_t>(row, col) == static_cast<std::uint8_t>(Reason::measured);
  }
  /// Makes a pixel invalid; an invalid pixel keeps the reason it has.
  void invalidate(int row, int col, Reason why) {
    auto& r = reason.at<std::uint8_t>(row, col);
    if (r == static_cast<std::uint8_t>(Reason::measured)) r = static_cast<std::uint8_t>(why);
  }
};

/// Another look at the same scene.
struct View {
  Camera camera;
  std::optional<Vector3> projector_xyz_mm;  ///< a light at another place; absent = the model's
  std::optional<double> time_s;             ///< another instant (device time); absent = this frame's
  ChannelSet wanted = static_cast<ChannelSet>(Channel::depth);
};

struct FrameInstant {
  int number = 0;           ///< 0 .. frames-1 in the capture
  double time_s = 0;        ///< device time since the capture's first frame
  /// Seconds since power-on; infinity in every capture that does not begin with power-on.
  double since_power_on_s = std::numeric_limits<double>::infinity();
};

/// What an effect may know when a capture begins. Outlives the Run.
struct CaptureContext {
  Camera camera;
  std::optional<Vector3> projector_xyz_mm;  ///< camera frame; absent = unknown
  double reference_distance_mm = 0;         ///< z0
  double depth_scale_mm = 0;                ///< storage step; 0 = none
  int frames = 1;
  bool power_on = false;
  bool motion = false;                      ///< poses differ between frames
  std::uint64_t seed = 1, unit_seed = 1, capture_key = 0;
  std::string instance;                     ///< id of the effect instance
  std::string model_folder;                 ///< relative files of options start here
  /// Renders another view of the scene at a frame. Absent where the source is not a scene (`binrig apply`).
  std::function<std::shared_ptr<const Channels>(const View&, int frame)> render;

  /// f * B, px mm: the focal length times the baseline's x; 0 where the projector is unknown.
  double focal_baseline() const {
    return projector_xyz_mm ? camera.fx * std::abs(projector_xyz_mm->x()) : 0.0;
  }
  /// Draws that are new in every frame / fixed through the capture / fixed for the unit.
  RandomStream draws(int frame) const { return frame_stream(seed, capture_key, frame, instance); }
  RandomStream capture_draws() const { return frame_stream(seed, capture_key, -1, instance); }
  RandomStream unit_draws() const { return unit_stream(unit_seed, instance); }
};

/// An effect at work on one capture: frames come in order, each once. State lives here and dies with the capture.
class Run {
 public:
  virtual ~Run() = default;
  virtual void apply(Layers& layers, const Channels& channels, const FrameInstant& instant) = 0;
};

struct Effect {
  EffectDeclaration declaration;
  /// Values are complete and within bounds. Throws Error for what the bounds cannot say (a spectrum file of another
  /// camera), naming instance.where.
  std::function<std::unique_ptr<Run>(const EffectInstance& instance, const CaptureContext& context)> begin;
  /// True where these values change nothing at all, so that the effect is skipped. Default: the amplitude parameter
  /// is at its neutral value.
  bool is_neutral(const EffectInstance& instance) const;
};

/// A Run without state of its own from a function.
std::unique_ptr<Run> stateless(std::function<void(Layers&, const Channels&, const FrameInstant&)> apply);

/// Every effect compiled in, in the order of their names (the table is written by the build).
const std::vector<const Effect*>& all_effects();
const Effect* find_effect(const std::string& name);
/// Their declarations.
const EffectCatalogue& effect_catalogue();

}  // namespace binrig
