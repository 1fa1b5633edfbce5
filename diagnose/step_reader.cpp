#include "diagnose/step_reader.h"

#include <fmt/format.h>

#include "diagnose/trace.h"

namespace binrig {

Experiment::FrameReader StepReader::reader() {
  return [this](int capture, int frame) {
    Frame read = frames_(capture, frame);
    if (experiment_.layout().train[capture]) {
      const std::lock_guard lock(guard_);
      values_.add(read.depth_mm, experiment_.context(capture).focal_baseline);
    }
    return read;
  };
}

SeenSteps StepReader::seen(const SensorModel& model) const {
  constexpr int most = 2;  // the strongest and the clearest
  constexpr double finest_mm = 0.02, coarsest_mm = 20, finest_px = 1.0 / 128, coarsest_px = 1;
  ValueSteps usual;
  for (int c = 0; c < experiment_.layout().captures; ++c) {
    if (!experiment_.layout().train[c]) continue;
    SimulationRequest request;
    request.capture = c;
    request.model = &model;
    request.frames = 1;
    experiment_.forward().simulate(
        request, [&](const Frame& frame, int) { usual.add(frame.depth_mm, experiment_.context(c).focal_baseline); });
  }
  SeenSteps seen{values_.depth_mm(finest_mm, coarsest_mm, most, usual),
                 values_.disparity_px(finest_px, coarsest_px, most, usual)};
  if (tracing()) {
    for (const ReadStep& step : seen.depth_mm) fmt::print(stderr, "a step in the values: {:.5g} mm\n", step.value);
    for (const ReadStep& step : seen.disparity_px) fmt::print(stderr, "a step in the values: {:.5g} px\n", step.value);
  }
  return seen;
}

}  // namespace binrig
