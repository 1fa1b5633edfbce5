// The forward model of a recording set, with planes fitted where the recording has neither mesh nor pose.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/forward_model.h"

namespace binrig {

struct ForwardOptions {
  std::string renderer = "auto";
  bool with_ir = false;
  std::vector<std::string> captures;  ///< keys ("train/1"); empty = all
};

struct Forward {
  std::unique_ptr<ForwardModel> model;
  /// What was fitted or left out, one sentence each, for the report ("train/3: no pose; a plane at 812 mm was fitted").
  std::vector<std::string> notes;
};

/// Plane targets without poses get a plane a frame; scenes whose meshes leave much of the measured surface unexplained
/// (objects on a table) get the plane of their largest flat region, too; labelled scenes without meshes get a plane for
/// their first label and boxes for the others. Throws Error if nothing can be simulated.
Forward open_forward_model(const std::string& set_path, const ForwardOptions& options = {});

/// Where the model says `projector: fit` and has no place yet: fits it to the train captures' shadows and puts it in.
/// With it goes the baseline of `second_shadow` where the model has that effect; where it has not, but the recording's
/// depth was registered to another camera and a second shadow is found, the effect is added.
/// Returns what was found in words, "" where there was nothing to do.
std::string settle_projector(SensorModel& model, const ForwardModel& forward);

}  // namespace binrig
