// Hypotheses that happen to whole frames or not, as chance has it (a frame comes twice): no fit says how often.
#pragma once

#include "diagnose/refine.h"

namespace binrig {

/// Does it happen to whole frames, as chance has it?
bool happens_or_not(const EffectDeclaration& effect);

/// The rung's model with such a hypothesis, as often as its signatures say, with a 95 % interval (how_often.h): `found`
/// is what they gain of the recording, of chi, by `ranking`, which is asked for simulated recordings, too. Throws what
/// simulating throws.
RefinedFit given_by_signatures(const Refiner& refiner, const Hypothesis& hypothesis, const LinearGain& found,
                               const Ranking& ranking);

}  // namespace binrig
