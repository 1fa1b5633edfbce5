// Calibration of recordings whose truth is known: the small campaign as the catalogue's own effects make it, from
// starts that lie elsewhere. How often intervals hold over many recordings is bench/calibrate_coverage.
#include "diagnose/calibration.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "bench/support/small_campaign.h"
#include "core/error.h"
#include "sim/effect.h"

namespace binrig {
namespace {

const bench::SmallCampaign& campaign() {
  static const bench::SmallCampaign campaign(true);
  return campaign;
}

SensorModel model_of(const std::string& effects) {
  return parse_sensor_model(
      "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n" +
          effects,
      "m", effect_catalogue());
}

Calibration calibrated(const std::string& truth, const std::string& start, CalibrationOptions options = {}) {
  const SceneForwardModel& forward = campaign().forward();
  const SensorModel instrument = model_of(truth), model = model_of(start);
  const auto recording = bench::simulated_recording(forward, instrument, bench::drawn_offsets(forward, 5), 5);
  SimulationCache cache("");
  const Experiment experiment(forward, model, cache);
  std::vector<std::string> unreadable;
  const Measurement measured = experiment.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
  options.simulations = 16;
  return calibrate(experiment, measured, model, options);
}

const CalibratedParameter& parameter(const Calibration& found, const std::string& id, const std::string& name) {
  for (const auto& p : found.parameters)
    if (p.id == id && p.name == name) return p;
  throw Error("no " + id + "." + name);
}

/// The interval holds the truth within three fifths of its own width (1.2 widths from the middle is five standard
/// deviations: no chance), and says something: it is narrower than `width`.
void expect_found(const Calibration& found, const std::string& id, const std::string& name, double truth,
                  double width) {
  const CalibratedParameter& p = parameter(found, id, name);
  ASSERT_TRUE(p.determined()) << id << "." << name << ": " << p.reason;
  const double low = (*p.ci95)[0], high = (*p.ci95)[1], middle = 0.5 * (low + high);
  EXPECT_LE(low, p.value);
  EXPECT_GE(high, p.value);
  EXPECT_LT(std::abs(truth - middle), 1.2 * (high - low)) << id << "." << name << " [" << low << ", " << high << "]";
  EXPECT_LT(high - low, width) << id << "." << name << " [" << low << ", " << high << "]";
  EXPECT_EQ(found.model.find(id)->value(name), p.value);
  EXPECT_EQ(found.model.find(id)->values.at(name).ci95, p.ci95);
}

TEST(Calibration, FindsABiasThatPosesCouldNotMakeAndTheNoise) {
  const Calibration found = calibrated("  - radial_distortion: {amplitude: 0.3}\n  - spectral_noise: {sigma: 0.3}\n",
                                       "  - radial_distortion: {amplitude: 0.1}\n  - spectral_noise: {sigma: 0.2}\n");
  EXPECT_TRUE(found.converged);
  expect_found(found, "radial_distortion", "amplitude", 0.3, 0.2);
  expect_found(found, "spectral_noise", "sigma", 0.3, 0.05);
}

TEST(Calibration, FindsDropOutsAndWhatSmoothsDepth) {
  const Calibration found =
      calibrated("  - spectral_noise: {sigma: 0.3}\n  - smoothing: {sigma: 0.9}\n  - random_dropout: {rate: 0.01}\n",
                 "  - spectral_noise: {sigma: 0.3}\n  - smoothing: {sigma: 0.6}\n  - random_dropout: {rate: 0.003}\n",
                 {.fixed = {"spectral_noise"}});
  expect_found(found, "random_dropout", "rate", 0.01, 0.004);
  expect_found(found, "smoothing", "sigma", 0.9, 0.3);
  for (const auto& p : found.parameters) EXPECT_NE(p.id, "spectral_noise");
}

TEST(Calibration, FindsAStepOfAboutTheNoise) {
  // 0.03 px are 0.4 mm at 800 mm. A step far beyond the noise has a valley at every tooth, none wider than a part in a
  // thousand: where planes show it, the program begins there.
  const Calibration found = calibrated("  - spectral_noise: {sigma: 0.3}\n  - disparity_quantisation: {step: 0.03}\n",
                                       "  - spectral_noise: {sigma: 0.3}\n  - disparity_quantisation: {step: 0.02}\n",
                                       {.only = {"disparity_quantisation"}});
  expect_found(found, "disparity_quantisation", "step", 0.03, 0.003);
  EXPECT_EQ(found.parameters.size(), 1u);
}

TEST(Calibration, FindsWhatMovesEdgesPixelAfterPixel) {
  // A wrong focal length is seen by edges, which move by whole pixels: chi has many valleys, and the slope at any of
  // them promises a tenth of the true uncertainty.
  const Calibration found =
      calibrated("  - focal_error: {error: 0.011}\n  - spectral_noise: {sigma: 0.3}\n",
                 "  - focal_error: {error: 0.0142}\n  - spectral_noise: {sigma: 0.3}\n", {.fixed = {"spectral_noise"}});
  expect_found(found, "focal_error", "error", 0.011, 0.02);
}

TEST(Calibration, FindsAPeriodThatTheStartMissed) {
  // 3 % off: half a wave less over this image. A period is fitted with everything else, round after round.
  const Calibration found =
      calibrated("  - row_banding: {amplitude: 0.3, period: 9, phase: 0.6}\n  - spectral_noise: {sigma: 0.3}\n",
                 "  - row_banding: {amplitude: 0.2, period: 9.27, phase: 0}\n  - spectral_noise: {sigma: 0.3}\n",
                 {.fixed = {"spectral_noise"}});
  expect_found(found, "row_banding", "period", 9, 0.1);
  expect_found(found, "row_banding", "amplitude", 0.3, 0.05);
  expect_found(found, "row_banding", "phase", 0.6, 0.2);
}

TEST(Calibration, FindsAThresholdThatMovesPixelAfterPixel) {
  // Where a mask is far from the measured one, slopes see the few pixels at its rim and promise next to nothing.
  const Calibration found =
      calibrated("  - low_confidence: {threshold: 36, disturbance: 0}\n  - spectral_noise: {sigma: 0.3}\n",
                 "  - low_confidence: {threshold: 39.5, disturbance: 0}\n  - spectral_noise: {sigma: 0.3}\n",
                 {.only = {"low_confidence.threshold"}});
  // Rows of pixels of the tilted planes lie 0.1 deg apart in incidence.
  expect_found(found, "low_confidence", "threshold", 36, 0.6);
}

TEST(Calibration, CountsFramesThatAreRepeated) {
  // In a recording others are repeated than in any simulation of it: the more a model repeats, the worse it looks.
  const std::string truth = "  - spectral_noise: {sigma: 0.3}\n  - frame_repeat: {probability: 0.25}\n";
  int repeated = 0, chances = 0;
  const SceneForwardModel& forward = campaign().forward();
  const auto recording = bench::simulated_recording(forward, model_of(truth), bench::drawn_offsets(forward, 5), 5);
  for (std::size_t c = 0; c < recording.size(); ++c)
    for (std::size_t i = 1; i < recording[c].size() && forward.captures()[c].split == "train"; ++i) {
      const cv::Mat &now = recording[c][i].depth_mm, &before = recording[c][i - 1].depth_mm;
      repeated += std::equal(now.begin<float>(), now.end<float>(), before.begin<float>());
      ++chances;
    }
  const Calibration found = calibrated(
      truth, "  - spectral_noise: {sigma: 0.3}\n  - frame_repeat: {probability: 0.1}\n", {.fixed = {"spectral_noise"}});
  // 10 chances: one more or less is 0.1, and which capture it happens in is worth another half.
  EXPECT_NEAR(parameter(found, "frame_repeat", "probability").value, static_cast<double>(repeated) / chances, 0.15);
  expect_found(found, "frame_repeat", "probability", 0.25, 0.7);
}

TEST(Calibration, FollowsTwoParametersThatMakeUpForEachOtherAlongTheirCurve) {
  // Highlights that never reach one and a half times the scale show the amplitude over the scale, and of either no more
  // than that it is not small: from a start that cuts highlights off, a straight line knows both to some hundredths.
  const Calibration found =
      calibrated("  - specular_ghost: {amplitude: -0.63, scale: 0.8}\n  - spectral_noise: {sigma: 0.1}\n",
                 "  - specular_ghost: {amplitude: -0.3, scale: 0.38}\n  - spectral_noise: {sigma: 0.1}\n",
                 {.fixed = {"spectral_noise"}});
  const CalibratedParameter &amplitude = parameter(found, "specular_ghost", "amplitude"),
                            &scale = parameter(found, "specular_ghost", "scale");
  EXPECT_NEAR(amplitude.value / scale.value, -0.63 / 0.8, 0.05);
  if (amplitude.determined()) {
    EXPECT_LE((*amplitude.ci95)[0], -0.63);
    EXPECT_GE((*amplitude.ci95)[1], -0.63);
    EXPECT_LT((*amplitude.ci95)[1], -0.2) << "this much is known";
  } else {
    EXPECT_NE(amplitude.reason.find("specular_ghost.scale"), std::string::npos) << amplitude.reason;
  }
  if (scale.determined()) {
    EXPECT_LE((*scale.ci95)[0], 0.8);
    EXPECT_GE((*scale.ci95)[1], 0.8);
  }
}

TEST(Calibration, NamesWhatTheRecordingCannotDetermine) {
  // Nothing in this campaign is ever as slanted as 89 degrees, and the effect of a lamp that is not lit has no place.
  const Calibration found =
      calibrated("  - spectral_noise: {sigma: 0.3}\n",
                 "  - low_confidence: {threshold: 130, disturbance: 0}\n  - spectral_noise: {sigma: 0.3}\n");
  for (const char* name : {"grid", "share"}) {
    const CalibratedParameter& p = parameter(found, "low_confidence", name);
    EXPECT_FALSE(p.determined()) << name;
    EXPECT_NE(p.reason, "");
    EXPECT_EQ(p.value, p.before);
    const ParameterValue& written = found.model.find("low_confidence")->values.at(name);
    EXPECT_FALSE(written.ci95.has_value());
    EXPECT_NE(written.provenance.find("not determined"), std::string::npos) << written.provenance;
  }
  EXPECT_TRUE(parameter(found, "spectral_noise", "sigma").determined());
}

TEST(Calibration, RefusesNamesThatAreNotThere) {
  EXPECT_THROW(calibrated("  - spectral_noise: {}\n", "  - spectral_noise: {}\n", {.fixed = {"spectral_noise.sigmma"}}),
               Error);
}

}  // namespace
}  // namespace binrig
