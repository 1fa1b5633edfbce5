// Hidden data: frames made by code of its own, straight from the formulas of the effects' documentation. Nothing here
// calls sim/effects; shared with the hypotheses are the physics (rendered perfect channels, core/coherent_noise.h for
// the disturbed thresholds, and the declared ranges that say what weak and strong mean).
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "core/effect_declaration.h"
#include "core/random.h"
#include "sim/scene_forward_model.h"

namespace binrig::hidden {

/// Numbers one after the other from a stream.
class Dice {
 public:
  explicit Dice(const RandomStream& stream) : stream_(stream) {}
  double uniform() { return stream_.uniform(next_++); }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double normal() { return stream_.normal(next_++); }
  double sign() { return uniform() < 0.5 ? -1 : 1; }
  /// The stream itself, for code that wants one.
  const RandomStream& stream() const { return stream_; }

 private:
  RandomStream stream_;
  std::uint64_t next_ = 0;
};

/// One capture being recorded.
struct Stand {
  const SceneForwardModel* forward = nullptr;
  const SensorModel* model = nullptr;  ///< says where the projector is; its effects do not count
  int capture = 0, frames = 1;
  Offset offset;  ///< where the target really stands
  Camera camera;  ///< as the camera file has it
  double focal_baseline = 0, z0 = 800;
  bool power_on = false, moves = false;
  std::uint64_t unit = 1;  ///< which specimen the instrument is
  std::string name;        ///< of the effect that is being prepared: keys its draws
  std::uint64_t seed = 1;  ///< of the recording and capture
  Dice capture_dice() const { return Dice(RandomStream(seed).child(name)); }
  Dice unit_dice() const { return Dice(RandomStream(unit).child(name)); }
  /// Another look at the scene: at another instant, through another lens, lit from another place.
  std::shared_ptr<const Channels> look(int frame, double time_s, double focal_factor, const Vector3* light,
                                       ChannelSet wanted) const;
};

/// One frame under construction.
struct Shot {
  int number = 0;
  double time_s = 0;
  double since_power_on_s = 0;  ///< infinite where the capture does not begin with power-on
  std::shared_ptr<const Channels> seen;
  cv::Mat_<float> z;      ///< mm
  cv::Mat_<float> scale;  ///< of the noise
  cv::Mat_<float> noise;  ///< mm
  cv::Mat_<uchar> hole;   ///< 1 = no depth
  double x(int u) const { return (u - cx) * per_px; }
  double y(int v) const { return (v - cy) * per_px; }
  double r2(int v, int u) const { return (x(u) * x(u) + y(v) * y(v)) * corner; }
  double cx = 0, cy = 0, per_px = 0, corner = 1;

  /// f(v, u) in every pixel that has depth.
  template <typename F>
  void each(F f) {
    for (int v = 0; v < z.rows; ++v)
      for (int u = 0; u < z.cols; ++u)
        if (!hole(v, u)) f(v, u);
  }
  /// z = f(z, v, u) in every pixel that has depth.
  template <typename F>
  void depth(F f) {
    each([&](int v, int u) { z(v, u) = static_cast<float>(f(z(v, u), v, u)); });
  }
  /// No more depth where f(v, u).
  template <typename F>
  void lose(F f) {
    each([&](int v, int u) {
      if (f(v, u)) hole(v, u) = 1;
    });
  }
};

using Values = std::map<std::string, double>;
/// Acts on one frame; made anew for every capture, frames come in order.
using Act = std::function<void(Shot&, Dice&)>;
struct Injection {
  Stage stage;
  std::function<Act(const Values&, const Stand&)> begin;
};

/// By the catalogue's names, and the outsiders by names of their own.
const std::map<std::string, Injection>& depth_injections();
const std::map<std::string, Injection>& signal_injections();
const std::map<std::string, Injection>& outside_injections();
const Injection& injection(const std::string& name);

/// White noise filtered by an amplitude over frequency (cycles/px: fy, fx), scaled to unit standard deviation in the
/// mean: an exact Gaussian field.
cv::Mat_<float> coloured_noise(cv::Size size, Dice& dice, const std::function<double(double, double)>& gain);

}  // namespace binrig::hidden
