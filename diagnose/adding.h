// A rung with one effect more, everything fitted again.
#pragma once

#include <optional>

#include "diagnose/search_result.h"

namespace binrig {

/// A model with the parameters of the effects that `given` has, too, as they are there.
SensorModel with_values_of(const SensorModel& given, SensorModel model);

class Adding {
 public:
  /// `given`: the model as the user gave it. `seed`: of signatures about it. What is given must outlive this.
  Adding(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
         const SensorModel& given, std::uint64_t seed)
      : experiment_(experiment), motions_(motions), measured_(measured), given_(given), seed_(seed) {}

  /// The rung's model with a hypothesis added. What the model had before was bent to make up for what was missing: it
  /// begins `anew` where the user put it, or stays where it is. Throws what simulating throws.
  Rung to(const Rung& rung, const Refined& hypothesis, RungOptions options, bool anew = true) const;

  /// The model's own noise may have taken the part of a ring in the spectrum, and the ring that of the noise; poses and
  /// lens that of a wrong focal length. No slope leads from there to where each plays its own. The rung's model as the
  /// user gave it, targets and lens where they are stated, with the hypothesis where its signatures about that model
  /// come nearest; none if they explain nothing. Throws what simulating throws.
  std::optional<Rung> to_the_given(const Rung& rung, const Hypothesis& hypothesis, RungOptions options) const;

  /// Where an effect that was added moves bias maps as the lens does, the two may end anywhere between them, on edges
  /// that happen to meet the pixels. The lens put back to where it is said to be, what it stood for given to the effect
  /// (`id`), everything fitted again from there; none if no parameter of it moves the same. Throws what simulating
  /// throws.
  std::optional<Rung> lens_put_back(const Rung& rung, const std::string& id, RungOptions options) const;

  /// What is known of an effect's parameters without a fit stays: puts it among the options' fixed ones.
  static void hold(const Refined& hypothesis, RungOptions& options);

 private:
  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Measurement& measured_;
  const SensorModel& given_;
  const std::uint64_t seed_;
};

}  // namespace binrig
