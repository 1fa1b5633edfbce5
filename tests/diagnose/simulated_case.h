// A recording that the catalogue makes of a known truth on the small campaign, and a model that is to be fitted to it.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "bench/support/small_campaign.h"
#include "diagnose/registration.h"
#include "diagnose/rung.h"
#include "sim/effect.h"

namespace binrig {

inline const bench::SmallCampaign& campaign() {
  static const bench::SmallCampaign campaign(true);
  return campaign;
}

/// Correlated noise and nothing else.
inline SensorModel noise_alone(double sigma_mm) {
  return parse_sensor_model(
      "name: m\nsensor: effects\ncamera: recording\nprojector: recording\nreference_distance: recording\n"
      "depth_scale: recording\neffects:\n  - spectral_noise: {sigma: " +
          std::to_string(sigma_mm) + "}\n",
      "m", effect_catalogue());
}

/// One effect on correlated noise of 0.3 mm.
inline SensorModel model_with(const std::string& effect, const std::map<std::string, double>& values) {
  SensorModel model = noise_alone(0.3);
  add_effect(model, effect_catalogue(), effect, values);
  return model;
}

/// What the catalogue makes of a truth, and a model that is to be fitted to it.
struct Case {
  Case(const SensorModel& truth, const SensorModel& start, const bench::SmallCampaign& of = campaign(),
       std::uint64_t seed = 5)
      : recording(bench::simulated_recording(of.forward(), truth, bench::drawn_offsets(of.forward(), seed), seed)),
        truth(truth),
        start(start),
        experiment(of.forward(), start, cache),
        motions(
            scene_motions(experiment, start, registration_prior(of.forward().set(), experiment.nominal(0).camera))) {
    std::vector<std::string> unreadable;
    measured = experiment.measure([&](int c, int i) { return recording[c][i]; }, unreadable);
  }
  Rung fitted(const RungOptions& options) const { return fit_rung(experiment, motions, measured, start, {}, options); }

  const bench::Recording recording;
  const SensorModel truth, start;
  SimulationCache cache{""};
  const Experiment experiment;
  const std::vector<SceneMotion> motions;
  Measurement measured;
};

}  // namespace binrig
