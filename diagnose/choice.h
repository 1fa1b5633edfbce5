// Which of two hypotheses that both prove themselves is added to a model: pure decisions, without simulations.
#pragma once

#include <functional>

#include "core/effect_declaration.h"
#include "diagnose/score.h"

namespace binrig {

/// By how much the statistics that a model leaves unexplained (SegmentFit::significant, diagnose/score.h) are beyond
/// its own randomness, in all.
double unexplained_excess(const std::vector<SegmentFit>& fits);

/// What is left where one of them was added and everything fitted again.
struct Contender {
  double dispersion = 1;    ///< of the rung; 1 = nothing
  double proper_score = 0;  ///< on captures held out, an element, lower is better
  /// Gain that the other's signatures still have there, dispersion and what chance makes of them taken off.
  std::function<double()> left_for_other;
  std::function<double()> unexplained;  ///< excess
  int parameters = 1;                   ///< of the effect that was added
};

struct Choice {
  bool runner_up = false;  ///< it is added, not the best
  /// The other is no rival: beside this one it has nothing left to explain, or it leaves what this one does not
  /// (a dispersion larger by 0.1, where this one's is next to 1).
  bool clear = false;
};

/// The runner-up came close behind the best. Where something is left by the best, the proper score decides, or, where
/// it is nearly the same (it sees the captures held out alone), less unexplained on either side; where something is
/// left by the runner-up only, the best is added. Where neither leaves anything to speak of: the right one leaves
/// nothing that the other would explain or, if what they leave each other differs by no more than `least_gain`, less
/// unexplained (by a quarter), unless the other has fewer parameters and a proper score that is clearly (0.01) lower;
/// if that is equal, too, the one with fewer parameters. What is not needed is not asked for.
Choice choose(const Contender& best, const Contender& runner_up, double least_gain);

/// What a model leaves, everything fitted.
struct Left {
  double heldout = 1;       ///< score
  double proper_score = 0;  ///< an element, lower is better
  Leftovers unexplained;
  double statistics = 1;  ///< the held-out score of statistics alone: Score::statistics
};

/// What is known of an effect that was added, beside what is left with it.
struct Addition {
  bool unproven = false;  ///< before everything was fitted with it, it had not proved itself on captures held out
  /// It was learned on train as a map of the unit and came back on the captures held out. Scores are of a typical unit:
  /// it is not in them.
  bool by_its_map = false;
  /// It lies in the model's randomness whether something happens at all: on the scale of the model with it, nothing was
  /// wrong before. What counts is what either model leaves in units of its own.
  bool happens_or_not = false;
  /// It draws a map anew in each capture: it is part of the model's randomness, of which the proper score alone knows
  /// (here proper_score_without_floor_of_bias). The held-out score falls by what else was fitted with it.
  bool draws = false;
};

/// Is the model with one effect more better than the one before? What lowers neither the held-out score (by 0.01) nor
/// the proper one is no improvement, nor is what draws and raises the proper one, or what raises it (0.0025; 0.01 if
/// nothing stays unexplained) where nothing but poses or the lens is unexplained. Where nothing stays unexplained, the
/// least that the proper one falls by is enough. So it is for an effect that had not proved itself, at the floor;
/// elsewhere that has to take a quarter of what is left. Where poses or intrinsics had gone further than the statistics
/// say, to make up for something missing, they may go on: then it has to take half of what is left of the statistics,
/// and lower the proper score. So they may where nothing is unexplained on either side and the statistics' part of
/// the held-out score hardly rises (0.1): a proper score that is clearly (0.01) lower says far more than their few
/// numbers.
bool makes_better(const Left& before, const Left& after, const Addition& addition);

/// Does the other leave so much less that it is to take the place of the one in the model: by the proper score (0.01)
/// without more on captures held out, or a quarter of what is left of the held-out score (at least 0.1) without a worse
/// proper one?
bool takes_the_place(const Left& present, const Left& other);

/// Does the other leave nothing more unexplained, and hardly more on captures held out (0.02)?
bool as_good(const Left& present, const Left& other);

/// Is one effect as good as two in its place: as_good, and the proper score no larger by 0.0025, or by twice that where
/// the held-out score is lower; or, if the proper score is lower, does the held-out one hardly rise (0.1: chance in
/// three numbers of the lens), nothing more unexplained?
bool does_for_two(const Left& present, const Left& other);

/// Are two effects that have fewer parameters than the one in the model better in its place: does_for_two holds of
/// them, and the held-out score is clearly lower (0.02)? Else one is more likely than two.
bool two_do_better(const Left& present, const Left& two);

/// Is an effect weaker than half of the low end of its typical range, the least that real instruments show? Never true
/// of those whose smaller values are the stronger ones, or that are absent at another value than 0.
bool hardly_there(const EffectDeclaration& effect, double amplitude);

/// Is less left unexplained than before, and nothing else?
bool leaves_less(const Leftovers& before, const Leftovers& after);

}  // namespace binrig
