// What a search found, and how it is judged: what is no child of chance, what proved itself on captures held out, what
// the data cannot tell apart.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "diagnose/rung.h"
#include "diagnose/signatures.h"

namespace binrig {

/// A hypothesis refined by simulating with it, its nuisances marginalised.
struct Refined {
  int hypothesis = 0;                    ///< index
  std::string effect, id;                ///< id of the added instance
  SensorModel model;                     ///< the rung's model with the effect at its best parameters
  Fit fit;                               ///< of the effect's parameters
  double linear_gain = 0, price = 0;     ///< of chi, dispersion divided out: gain of the signatures, a null's mean gain
  double gate = 0;                       ///< what gain less price has to exceed
  double train_gain = 0, test_gain = 0;  ///< of chi, by simulation, dispersion divided out
  /// Of the excess on train over the model's own randomness, or over that with the hypothesis if it has more, that
  /// train_gain is.
  double share = 1;
  PValue p;
  bool happens_or_not = false;  ///< to whole frames, as chance has it
  bool draws = false;           ///< maps, one a capture: what it gains is power, not a shape
  bool random_map = true;       ///< false: it draws a map of the unit, but what is fixed in the image looks like none
  /// Its parameters are those of a map that was recognised, or what its signatures say, with intervals: no fit says
  /// more of them.
  bool held = false;
  bool from_given = false;   ///< a second look from the parameters as given put it where it is
  bool step_seen = false;    ///< stands at a step that was read off the recorded values, and stays there
  bool certain = false;      ///< of which nearly all values are whole multiples: no gain needs to prove it
  Whitened change;           ///< what it moves, all captures
  double shown_on_test = 0;  ///< square of that on the captures held out, dispersion divided out
  int shown_in = 0;          ///< the train capture that shows it most
  double score() const { return train_gain - price + test_gain; }
};

struct SearchOptions {
  int shortlist = 12;          ///< so many with the largest linear gain are simulated as they are,
  double linear_until = 1.3;   ///< where the rung's dispersion is larger than this
  double disappointing = 0.5;  ///< share of the linear gain: a ring that gains less is fitted by what seeds agree on
  int refine = 4;              ///< so many are fitted, and those that
  /// gain at least this share of what the best of the list does. Fitted, it makes a rival, which is tried in the best
  /// one's place if that leaves something,
  double rival = 0.75;
  double close_behind = 0.9;   ///< share of the best one's gain: what comes so close is tried in its place, too,
  double close_from_given = 0.5;  ///< and with so much what was fitted from the parameters as given
  double overtakes = 0.5;      ///< where much is missing, places are looked for closely with this share of the best's
  double hopeless = 0.3;  ///< unless they explain less than this share (half of it if they have periods or places) of
                          ///< what the best does
  /// Where the linear gain falls short of the gate but not of this share of it, so many are fitted, too: signatures
  /// know few places and periods. They must then gain so many times the gate.
  double doubtful = 0.2;
  int doubted = 2;
  double beyond_doubt = 2;
  int seeds = 2;
  std::uint64_t seed = 501;
  double astray = 3;          ///< dispersion beyond which, whoever explains it, hypotheses are fitted anew,
  double unexplained = 1.15;  ///< and beyond which if nobody does
  double misplaced = 3;       ///< so does a mean square of poses or intrinsics, in stated uncertainties
  double bent = 1;            ///< and a parameter, in standard deviations of its wide prior;
  int anew = 2;               ///< so many;
  double far_ahead = 5;  ///< but not where the best leaves many missing and gains so many times what the second does,
  double nearly_all = 0.75, next_to_nothing = 0.3;  ///< or explains so much of the excess and others so little of that
  double far_ahead_on_train = 3;  ///< what did not prove itself is tried where it gains so many times what did on train
  double least_test_gain = 9;     ///< three standard deviations of an effect that is known
  double least_train_gain = 16;
  double least_share = 0.02;  ///< of the excess: in a large remainder, chance resemblances gain, too
};

struct SearchResult {
  std::vector<LinearGain> linear;  ///< all hypotheses, in their order
  std::vector<double> prices;
  std::vector<PValue> p_values;
  std::vector<std::vector<double>> null_gains;  ///< by hypothesis
  double gate = 0;                              ///< gain less price beyond which hypotheses are no children of chance
  std::vector<Refined> refined;                 ///< best first
  bool looked_again = false;                    ///< from the parameters as given
  bool looked_closely = false;                  ///< for waves between those that signatures know
  std::set<std::string> no_maps;                ///< effects whose map, fitted, did not look random; Standing's, too
  /// Those that are certain, or significant on train and confirmed on test, best first.
  std::vector<const Refined*> accepted(const SearchOptions& options) const;
  /// What happens or not, if its signatures are beyond doubt and gain more than those of any other but of such as draw a
  /// map in each capture: beside it no fit of another means anything, since its randomness is in neither. Null if there
  /// is none.
  const Refined* happening(const SearchOptions& options) const;
  /// Those that are beyond doubt on train and show on test, but explain nothing there as long as the model's other
  /// parameters stay where they were bent to without them. And those of which the signatures are beyond doubt, but that
  /// happen or do not, and in the recording did when in their simulations they did not: on the scale of a model in
  /// which they never happen, that counts against them. Best first.
  std::vector<const Refined*> unproven(const SearchOptions& options) const;
  /// Those that are significant on train, but that the captures held out could not confirm whoever is right.
  std::vector<const Refined*> unconfirmed(const SearchOptions& options) const;
  /// Those that are worth being put into the model, best first: what happens or not if that is beyond doubt, else those
  /// accepted. Before them those unproven, all if none proved itself, else only those that explain far more on train
  /// than the best that did: frames that shake as wholes make noise maps of the captures held out larger or smaller as
  /// wholes, which on the scale of a model that stands still counts against them.
  std::vector<const Refined*> worthy(const SearchOptions& options) const;
  /// One explains nearly all that is left on train, as the captures held out confirm, and the others next to nothing of
  /// that: whatever parameters were bent to, they do not hide what is missing.
  bool explained_by_one(const SearchOptions& options) const;
};

/// Have poses or the lens gone further on train than the recording states, to make up for what is missing?
bool misplaced(const Rung& rung, const SearchOptions& options);

/// Does it gain nearly as much as the best one (close_behind)? Half as much is near for what was fitted from the
/// parameters as given, beside a best one that leans on bent ones: it needs none bent to gain that. Where the best one
/// could not prove itself on the captures held out, those count for neither: a target may stand wrong without it there.
bool comes_close(const Refined& best, const Refined& other, const SearchOptions& options);

/// Does it gain at least the share `rival` of what the best one does?
bool is_rival(const Refined& best, const Refined& other, const SearchOptions& options);

/// How far two refined hypotheses can be told apart on these captures: squared distance of what they move, and the
/// cosine of the angle between, both with nuisances marginalised.
struct Separation {
  double distance2 = 0, cosine = 0;
};
Separation separation(const Rung& rung, const Refined& a, const Refined& b);
/// Do they move something in common (cosine of at least 0.1), or do both draw maps, which have power in common and
/// no cosine? If not, each explains its own.
bool moves_the_same(const Rung& rung, const Refined& a, const Refined& b);
/// True if the data cannot tell b from a, which is taken for the better one: what a gains over b lies within what
/// chance makes of two models that far apart, or is less than a quarter of what a gains where b gains more by its
/// signatures, or as much but for chance (9) and both move mostly the same (cosine of 0.7). Of a weaker one that comes
/// later, a stronger b that moves nothing in common with it is none.
bool confounded(const Rung& rung, const Refined& a, const Refined& b);

/// Those of `worthy` (best first) that move nothing that the best one moves, nor what those before them move
/// (moves_the_same), and that gain a quarter of what it does: each explains its own, whichever comes first.
std::vector<const Refined*> standing_beside(const Rung& rung, const Refined& best,
                                            const std::vector<const Refined*>& worthy);

}  // namespace binrig
