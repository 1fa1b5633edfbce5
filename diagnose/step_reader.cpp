#include "diagnose/step_reader.h"

#include <fmt/format.h>

#include "diagnose/trace.h"

namespace binrig {

ValueSteps simulated_values(const Experiment& experiment, const SensorModel& model) {
  ValueSteps values;
  for (int c = 0; c < experiment.layout().captures; ++c) {
    if (!experiment.layout().train[c]) continue;
    SimulationRequest request;
    request.capture = c;
    request.model = &model;
    request.frames = 1;
    experiment.forward().simulate(
        request, [&](const Frame& frame, int) { values.add(frame, experiment.context(c).focal_baseline); });
  }
  return values;
}

SeenSteps seen_steps(const ValueSteps& values, const ValueSteps& usual) {
  constexpr int most = 2;  // the strongest and the clearest
  constexpr double finest_mm = 0.02, coarsest_mm = 20, finest_px = 1.0 / 128, coarsest_px = 1;
  SeenSteps seen{values.depth_mm(finest_mm, coarsest_mm, most, usual),
                 values.disparity_px(finest_px, coarsest_px, most, usual)};
  if (tracing()) {
    for (const ReadStep& step : seen.depth_mm) fmt::print(stderr, "a step in the values: {:.5g} mm\n", step.value);
    for (const ReadStep& step : seen.disparity_px) fmt::print(stderr, "a step in the values: {:.5g} px\n", step.value);
  }
  return seen;
}

SensorModel without_steps(SensorModel model, const EffectCatalogue& catalogue) {
  std::erase_if(model.effects, [&](const EffectInstance& e) { return is_step(e.declaration(catalogue)); });
  return model;
}

Experiment::FrameReader StepReader::reader() {
  return [this](int capture, int frame) {
    Frame read = frames_(capture, frame);
    if (experiment_.layout().train[capture]) {
      const std::lock_guard lock(guard_);
      values_.add(read, experiment_.context(capture).focal_baseline);
    }
    return read;
  };
}

SeenSteps StepReader::seen(const SensorModel& model) const {
  return seen_steps(values_, simulated_values(experiment_, model));
}

}  // namespace binrig
