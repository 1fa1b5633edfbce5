// Which single effect, added to a model, moves its statistics onto the measured ones, on captures it was not fitted to.
#pragma once

#include <functional>
#include <vector>

#include "diagnose/search_result.h"

namespace binrig {

/// Gains are of chi (whitened, dimensionless), those of refined hypotheses with the rung's dispersion divided out.
/// `motions`: of scene_motions for this experiment; targets are put where each hypothesis wants them. `signatures`: of
/// `hypotheses`, by their indices. `given`: the model as it was given; `book`: signatures about it, for fits from
/// there, asked for if they are needed. Throws what simulating throws.
SearchResult search(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung,
                    const Measurement& measured, const Hypotheses& hypotheses, const std::vector<Signature>& signatures,
                    const SensorModel& given, const std::function<const SignatureBook&()>& book,
                    const SearchOptions& options);

}  // namespace binrig
