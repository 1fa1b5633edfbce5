// A ring in the spectrum of the noise: it moves a few statistics, and what else it adds is noise in thousands of
// others, in which simulations toss for more than the ring explains. What all simulations agree on is looked at alone.
#pragma once

#include "diagnose/refine.h"

namespace binrig {

/// What the rung's model leaves without and with the effects that `model` has besides, targets where the rung has them:
/// the change between simulations with the same seeds, as far as the seeds agree, on top of the mean of the rung's many
/// simulations. `mean`: of that change, whitened. Throws what simulating throws.
struct ClearRemainders {
  Remainder without, with;
};
ClearRemainders clear_remainders(const Refiner& refiner, const SensorModel& model);

/// The rung's model with a hypothesis that has a tone (has_tone), its strength and what is log_scaled fitted to train
/// by its signatures from `start`, then averaged over a grid about there, with 95 % intervals. Throws what simulating
/// throws.
RefinedFit refine_tone(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& start);

}  // namespace binrig
