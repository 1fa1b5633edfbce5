// What a model file needs when it is written somewhere else.
#pragma once

#include <string>

#include "core/sensor_model.h"

namespace binrig {

/// File options are relative to the model file: rewrites them for a model that moves to `out`, and sets its `file`.
void rebase_files(SensorModel& model, const std::string& out);

}  // namespace binrig
