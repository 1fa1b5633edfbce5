// What looks like an effect that was added: when more is in the model, it may take its place, or that of two.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "diagnose/adding.h"
#include "diagnose/candidates.h"
#include "diagnose/choice.h"
#include "diagnose/climb.h"

namespace binrig {

/// What a rung leaves and what one that comes after it does, the second one's randomness being the scale. `draws`: see
/// Addition.
std::pair<Left, Left> left_by(const Layout& layout, const std::vector<SceneMotion>& motions, const StatVector& data,
                              const Rung& one, const Rung& next, bool draws);

class LookAlikes {
 public:
  /// Keeps references. `climbed`: the ladder so far, which changes as it grows. `finish`: does what is done to a rung
  /// before it is put there.
  LookAlikes(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
             const Adding& adding, const Candidates& candidates, const SearchOptions& options, Climbed& climbed,
             std::function<void(Rung&, const RungOptions&)> finish)
      : experiment_(experiment),
        motions_(motions),
        measured_(measured),
        catalogue_(experiment.forward().catalogue()),
        adding_(adding),
        candidates_(candidates),
        options_(options),
        climbed_(climbed),
        finish_(std::move(finish)) {}

  /// Nothing is known any more of what looks like the candidates that were climbed.
  void forget() { others_.assign(climbed_.candidates.size(), {}); }

  /// `found` was put on the ladder last. Where little is left, it and one added before it may be one effect; what came
  /// close to one added before it may do better in its place. Throws what simulating throws.
  void added(const Found& found);

  /// Nothing more was found: two that together do what one does that has more parameters than both may be better in its
  /// place, where little is left. `full`: no effect more is allowed. Throws what simulating throws.
  void two_for_one(const std::function<bool()>& full);

 private:
  /// The last rung's model with others in the place of some that were added, everything fitted again.
  struct InPlace {
    std::vector<Refined> added;
    RungOptions options;
    Rung rung;
    Left before, after;
  };
  InPlace in_place_of(const std::vector<std::string>& ids, const std::vector<Refined>& others) const;
  void put_in_place(std::size_t k, InPlace in_place, const std::string& gone);
  bool take_one_for_two(std::size_t k, const Refined& other);
  void take_two_for_one(std::size_t k);
  void exchange(std::size_t k, const Refined& other);
  std::vector<Refined> simpler_two(std::size_t k) const;
  std::vector<int> places_of(const std::vector<std::string>& ids) const;
  bool overlaps(const Refined& other, std::size_t k, const Refined& later) const;
  bool named_beside(std::size_t k, const std::string& effect) const;
  bool is_added(const std::string& effect) const;
  /// Until the ladder grows, even if it shrinks again: that moves all rungs.
  const Rung& last() const { return climbed_.rungs.back(); }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Measurement& measured_;
  const EffectCatalogue& catalogue_;
  const Adding& adding_;
  const Candidates& candidates_;
  const SearchOptions& options_;
  Climbed& climbed_;
  const std::function<void(Rung&, const RungOptions&)> finish_;
  struct Others {
    Refined added;
    std::vector<Refined> others;  ///< that explained much of the same
    bool had_their_turn = false;  ///< to take its place
  };
  std::vector<Others> others_;  // by candidate
};

}  // namespace binrig
