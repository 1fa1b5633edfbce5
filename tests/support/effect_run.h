// One effect alone on channels, for the tests of effects.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "sim/effect.h"
#include "sim/sensor.h"
#include "tests/support/analytic_scene.h"

namespace binrig::test {

using Values = std::map<std::string, double>;

/// An instance with initial values but for those given. Throws std::out_of_range for a parameter that does not exist.
EffectInstance make_instance(const std::string& effect, const Values& values = {},
                             const std::map<std::string, std::string>& options = {});

/// Layers at the start of a frame: perfect depth, every pixel with depth measured.
Layers fresh_layers(const Channels& channels);

/// An effect at work on the analytic scene of a context.
class EffectUnderTest {
 public:
  EffectUnderTest(const EffectInstance& instance, CaptureContext context);
  /// Applies the effect to layers of frame `number` (device time 0.1 s a frame unless given).
  void apply(Layers& layers, const Channels& channels, int number = 0, double time_s = -1);
  Layers frame(const Channels& channels, int number = 0, double time_s = -1);

 private:
  CaptureContext context_;
  std::unique_ptr<Run> run_;
};

/// Depth of one frame under one effect, channels of the scene from small_camera(); NaN where invalid, so that a test
/// that forgets the reason fails.
cv::Mat depth_under(const std::string& effect, const Values& values, const AnalyticScene& scene);

/// Standard deviation (mm) over valid pixels of `region` (empty = all) and four frames of what the effect makes of
/// white noise with sigma = 1 mm.
double noise_under(const std::string& effect, const Values& values, const AnalyticScene& scene, const Camera& camera,
                   cv::Rect region = {});

/// A camera with so narrow a view that distance, incidence and light are nearly the same in every pixel.
Camera narrow_camera();

/// Mean and standard deviation of an image (CV_32F).
std::pair<double, double> mean_and_deviation(const cv::Mat& image);
/// Share of pixels with a reason.
double share_with(const Layers& layers, Reason reason);

}  // namespace binrig::test
