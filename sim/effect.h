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
#include "core/coherent_noise.h"
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
  int number = 0;     ///< 0 .. frames-1 in the capture
  double time_s = 0;  ///< device time since the capture's first frame
  /// Seconds since power-on; infinity in every capture that does not begin with power-on.
  double since_power_on_s = std::numeric_limits<double>::infinity();
};

/// What an effect may know when a capture begins. Outlives the Run.
struct CaptureContext {
  Camera camera;
  std::optional<Vector3> projector_xyz_mm;  ///< camera frame; absent = unknown
  double reference_distance_mm = 0;         ///< z0
  double depth_scale_mm = 0;                ///< storage step; 0 = none
  int frames = 1;                           ///< 0 = endless or unknown
  bool power_on = false;
  bool motion = false;  ///< poses differ between frames
  std::uint64_t seed = 1, unit_seed = 1, capture_key = 0;
  std::string instance;                                         ///< id of the effect instance
  std::string model_folder;                                     ///< relative files of options start here
  ChannelSet wanted = static_cast<ChannelSet>(Channel::depth);  ///< what any effect of the model reads
  /// Renders another view of the scene at a frame. Absent where the source is not a scene (`binrig apply`).
  std::function<std::shared_ptr<const Channels>(const View&, int frame)> render;

  /// f * B, px mm: the focal length times the baseline's x; 0 where the projector is unknown.
  double focal_baseline() const { return projector_xyz_mm ? camera.fx * std::abs(projector_xyz_mm->x()) : 0.0; }
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

/// An effect of Stage::view: it looks at another view than the nominal one, through another lens, at another instant.
/// Depth becomes what is seen there, plus what earlier effects had added to the nominal one; where it meets nothing the
/// pixel becomes no_surface, where only it meets something, valid. Effects that come after read their channels from that
/// view, too: a shadow is where the lens sees it. Of two such effects both differences of depth are kept, and the later
/// one's view is read.
class OtherView : public Run {
 public:
  /// `nominal`: whatever effects came before.
  void apply(Layers& layers, const Channels& nominal, const FrameInstant& instant) final;
  const Channels& seen() const { return *seen_; }

 protected:
  /// With all channels of CaptureContext::wanted.
  virtual std::shared_ptr<const Channels> look(const FrameInstant& instant) = 0;

 private:
  std::shared_ptr<const Channels> seen_;
};

struct Effect {
  EffectDeclaration declaration;
  /// Values are complete and within bounds. Throws Error for what the bounds cannot say (a spectrum file of another
  /// camera), naming instance.where.
  std::function<std::unique_ptr<Run>(const EffectInstance& instance, const CaptureContext& context)> begin;
  /// For effects whose options decide which channels they read (formula); absent = declaration.reads.
  std::function<ChannelSet(const EffectInstance& instance)> reads = {};

  ChannelSet channels_read(const EffectInstance& instance) const { return reads ? reads(instance) : declaration.reads; }
  /// True where these values change nothing at all, so that the effect is skipped: every parameter that declares a
  /// neutral value stands at it (most effects have one such parameter, their amplitude).
  bool is_neutral(const EffectInstance& instance) const;
};

/// A Run without state of its own from a function.
std::unique_ptr<Run> stateless(std::function<void(Layers&, const Channels&, const FrameInstant&)> apply);
/// A Run that adds the same errors (CV_32F, mm, of the image's size) to the valid depths of every frame.
std::unique_ptr<Run> adding(const cv::Mat& error_mm);

/// body(first, last) over blocks of rows that cover 0 .. rows-1, on several threads where the image is large. The
/// result must not depend on where the blocks end.
void for_rows(cv::Size size, const std::function<void(int first, int last)>& body);

/// z = map(z, col) in every valid pixel; `map_of_row(row)` gives the map of one row, so that it can hold row pointers
/// by value and its inner loop vectorises. The map must be harmless (it may be wrong) for the depth of invalid pixels.
template <class MapOfRow>
void map_depth(Layers& layers, const MapOfRow& map_of_row) {
  for_rows(layers.depth_mm.size(), [&](int first, int last) {
    for (int row = first; row < last; ++row) {
      const auto map = map_of_row(row);
      float* z = layers.depth_mm.ptr<float>(row);
      const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
      for (int col = 0; col < layers.depth_mm.cols; ++col) {
        const float mapped = map(z[col], col);
        z[col] = reason[col] == 0 ? mapped : z[col];
      }
    }
  });
}

/// Gives every valid pixel where `predicate_of_row(row)(col)` holds the reason `why`.
template <class PredicateOfRow>
void invalidate_where(Layers& layers, Reason why, const PredicateOfRow& predicate_of_row) {
  for_rows(layers.depth_mm.size(), [&](int first, int last) {
    const int cols = layers.depth_mm.cols;
    std::vector<int> hit(cols);  // loops of one width each: the compiler vectorises no others
    for (int row = first; row < last; ++row) {
      const auto predicate = predicate_of_row(row);
      for (int col = 0; col < cols; ++col) hit[col] = predicate(col) ? static_cast<int>(why) : 0;
      std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
      for (int col = 0; col < cols; ++col) {
        const auto its = static_cast<std::uint8_t>(hit[col]);
        reason[col] = reason[col] == 0 ? its : reason[col];
      }
    }
  });
}

/// Is there a pixel, still valid, whose value (CV_32F) lies in low .. high?
bool any_between(const Layers& layers, const cv::Mat& value, float low, float high);

/// sigma_scale = sigma_scale * factor(col), in every pixel.
template <class FactorOfRow>
void scale_sigma(Layers& layers, const FactorOfRow& factor_of_row) {
  for_rows(layers.depth_mm.size(), [&](int first, int last) {
    for (int row = first; row < last; ++row) {
      const auto factor = factor_of_row(row);
      float* scale = layers.sigma_scale.ptr<float>(row);
      for (int col = 0; col < layers.depth_mm.cols; ++col) scale[col] *= factor(col);
    }
  });
}

/// Depth at a disparity that is larger by `delta_px`: fB / (fB/z + delta). `focal_baseline` in px mm; 0 for z = 0. A
/// disparity that would fall to nothing gives a depth far beyond every range instead of an infinite one.
inline float with_disparity_added(float z_mm, float delta_px, float focal_baseline) {
  const float ratio = 1.f + delta_px * z_mm / focal_baseline;
  return z_mm / (ratio > 1e-3f ? ratio : 1e-3f);
}

/// Least and largest valid depth of the square of half width `half` around a pixel that is valid itself.
std::pair<float, float> valid_range(const cv::Mat& depth_mm, const cv::Mat& reason, int row, int col, int half);

/// What the disturbed thresholds share (thesis 5.3.7): the spread's spatial size, how much of it is new in every frame,
/// and the weight function; and the field that they describe, keyed by the instance.
ParameterSpec disturbance_grid();
ParameterSpec disturbance_share();
OptionSpec disturbance_weight();
DisturbanceField disturbance_field(const EffectInstance& instance, const CaptureContext& context);

/// Every effect compiled in, in the order of their names (the table is written by the build).
const std::vector<const Effect*>& all_effects();
const Effect* find_effect(const std::string& name);
/// Their declarations.
const EffectCatalogue& effect_catalogue();

}  // namespace binrig
