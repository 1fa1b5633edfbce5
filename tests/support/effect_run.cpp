#include "tests/support/effect_run.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <opencv2/core.hpp>

namespace binrig::test {

EffectInstance make_instance(const std::string& name, const Values& values,
                             const std::map<std::string, std::string>& options) {
  const Effect* effect = find_effect(name);
  if (!effect) throw std::out_of_range("no effect " + name);
  EffectInstance instance;
  instance.effect = instance.id = name;
  instance.where = "test:1";
  for (const ParameterSpec& parameter : effect->declaration.parameters) {
    instance.values[parameter.name].value = parameter.initial;
  }
  for (const OptionSpec& option : effect->declaration.options) instance.options[option.name] = option.default_value;
  for (const auto& [key, value] : values) instance.values.at(key).value = value;
  for (const auto& [key, value] : options) instance.options.at(key) = value;
  return instance;
}

Layers fresh_layers(const Channels& channels) {
  Layers layers;
  layers.depth_mm = channels.depth_mm.clone();
  layers.sigma_scale = cv::Mat(layers.depth_mm.size(), CV_32F, cv::Scalar(1));
  layers.noise_mm = cv::Mat::zeros(layers.depth_mm.size(), CV_32F);
  layers.reason = cv::Mat(layers.depth_mm.size(), CV_8U, cv::Scalar(static_cast<int>(Reason::no_surface)));
  layers.reason.setTo(0, layers.depth_mm > 0);
  layers.ir = channels.ir.clone();
  return layers;
}

EffectUnderTest::EffectUnderTest(const EffectInstance& instance, CaptureContext context)
    : context_(std::move(context)) {
  context_.instance = instance.id;
  run_ = find_effect(instance.effect)->begin(instance, context_);
}

void EffectUnderTest::apply(Layers& layers, const Channels& channels, int number, double time_s) {
  FrameInstant instant;
  instant.number = number;
  instant.time_s = time_s < 0 ? 0.1 * number : time_s;
  if (context_.power_on) instant.since_power_on_s = instant.time_s;
  run_->apply(layers, channels, instant);
}

Layers EffectUnderTest::frame(const Channels& channels, int number, double time_s) {
  Layers layers = fresh_layers(channels);
  apply(layers, channels, number, time_s);
  return layers;
}

cv::Mat depth_under(const std::string& effect, const Values& values, const AnalyticScene& scene) {
  const CaptureContext context = analytic_context(scene, small_camera());
  const auto channels =
      analytic_channels(scene, context.camera, context.projector_xyz_mm, context.reference_distance_mm);
  EffectUnderTest run(make_instance(effect, values), context);
  Layers layers = run.frame(*channels);
  layers.depth_mm.setTo(std::numeric_limits<float>::quiet_NaN(), layers.reason != 0);
  return layers.depth_mm;
}

double noise_under(const std::string& effect, const Values& values, const AnalyticScene& scene, const Camera& camera,
                   cv::Rect region) {
  if (region.empty()) region = cv::Rect(0, 0, camera.width, camera.height);
  CaptureContext context = analytic_context(scene, camera);
  context.depth_scale_mm = 0;
  const auto channels = analytic_channels(scene, camera, context.projector_xyz_mm, context.reference_distance_mm);
  SensorModel model;
  model.effects = {make_instance(effect, values),
                   make_instance("spectral_noise", {{"sigma", 1}, {"white_share", 1}, {"correlation_length", 0}})};
  check_sensor_model(model, effect_catalogue());
  SensorRun run(model, context);
  if (!run.inactive().empty()) throw std::logic_error(run.inactive()[0].second);
  double square = 0, count = 0;
  for (int number = 0; number < 4; ++number) {
    FrameInstant instant;
    instant.number = number;
    const Frame frame = run.frame(*channels, instant);
    const cv::Mat residual = (frame.depth_mm - channels->depth_mm)(region), valid = (frame.reason == 0)(region);
    const double norm = cv::norm(residual, cv::NORM_L2, valid);
    square += norm * norm;
    count += cv::countNonZero(valid);
  }
  return std::sqrt(square / count);
}

Camera narrow_camera() {
  Camera camera = small_camera();
  camera.fx = camera.fy = 20000;
  return camera;
}

std::pair<double, double> mean_and_deviation(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return {mean[0], deviation[0]};
}

double share_with(const Layers& layers, Reason reason) {
  return cv::countNonZero(layers.reason == static_cast<int>(reason)) / static_cast<double>(layers.reason.total());
}

}  // namespace binrig::test
