// Recordings of the small campaign by an instrument with hidden effects.
#pragma once

#include <string>
#include <vector>

#include "bench/hidden_effects/shot.h"
#include "bench/support/small_campaign.h"

namespace binrig::hidden {

struct HiddenEffect {
  std::string name;  ///< of the catalogue, or of an outsider
  Values values;
};

std::vector<std::string> outsider_names();

/// An effect at a strength (the 15, 50 and 85 % points of its amplitude's typical range on a log scale); its sign,
/// phases and other parameters are drawn from the inner 70 % of their typical ranges.
HiddenEffect draw_hidden(const std::string& name, Strength strength, const RandomStream& stream);

/// What the instrument delivers: the five base effects that `instrument` has, by its numbers but not by its code, and
/// the hidden ones on top, each at its stage. Invalid pixels say no reason.
bench::Recording record(const SceneForwardModel& forward, const SensorModel& instrument,
                        const std::vector<HiddenEffect>& hidden, const std::vector<Offset>& offsets,
                        std::uint64_t seed);

/// Frames that were really recorded, with effects hidden in them: on top of all that the instrument did. `model` says
/// where the projector is. Throws Error for an effect that is no matter of depth once measured (a lens, how strong
/// noise is), and what reading frames throws.
bench::Recording record_on_top(const SceneForwardModel& forward, const SensorModel& model,
                               const std::vector<HiddenEffect>& hidden, std::uint64_t seed);

}  // namespace binrig::hidden
