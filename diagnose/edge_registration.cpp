#include "diagnose/edge_registration.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "diagnose/mean_of_simulations.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int seeds = 4;
constexpr double worth_it = 9;    // of a square: three standard deviations of one motion
constexpr double clearly = 0.95;  // of a square, what is left at most where a target stands better
constexpr int most_steps = 3;     // of one motion in one direction
constexpr int most_walks = 6;     // over all motions, as long as the target stands clearly better after one

/// Walks the target of one capture.
class Walk {
 public:
  Walk(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung, int capture,
       std::uint64_t seed)
      : experiment_(experiment),
        motions_(motions),
        rung_(rung),
        capture_(capture),
        seed_(seed),
        offsets_(rung.offsets),
        square_(square_at(offsets_)) {}

  /// True if it clearly stands better than before.
  bool run() {
    const double before = square_;
    double last = 0;
    for (int walk = 0; walk < most_walks && (walk == 0 || square_ < clearly * last); ++walk) {
      last = square_;
      over_all_motions();
    }
    if (tracing())
      fmt::print(stderr, "  capture {} registered by its edges: square {:.0f} -> {:.0f}\n", capture_, before, square_);
    return square_ < clearly * before;
  }

  const std::vector<Offset>& offsets() const { return offsets_; }

 private:
  void over_all_motions() {
    const bool far = is_far_out();
    for (const int element : {3, 4, 5, 0, 1, 2})  // shifts first
      for (std::size_t m = 0; m < motions_.size(); ++m) {
        if (motions_[m].capture != capture_ || motions_[m].element != element) continue;
        if (far) jump(m);
        for (const double reach : {1.0, 0.5})
          for (const double direction : {1.0, -1.0})
            for (int k = 0; k < most_steps && goes(m, direction * reach * registered_to(motions_[m])); ++k) {
            }
      }
  }

  bool is_far_out() const {
    constexpr double far_out = 5;  // of an element's mean square
    const auto& spread = rung_.standard.spread();
    int known = 0;
    for (const Block& block : experiment_.layout().blocks)
      if (block.capture == capture_)
        known += static_cast<int>(std::count_if(
            spread.begin() + block.offset, spread.begin() + block.offset + block.size, [](float v) { return v > 0; }));
    return square_ > far_out * known;
  }

  /// To the best of many places along one motion, none of which need be better than the one before: a plane between two
  /// coarse steps looks the same wherever it stands there.
  void jump(std::size_t m) {
    constexpr int furthest = 16, apart = 2;
    double best = 0, least = std::numeric_limits<double>::infinity();
    for (int k = -furthest; k <= furthest; k += apart) {
      const double by = k * registered_to(motions_[m]), square = square_at(moved(m, by), true);
      if (square < least) least = square, best = by;
    }
    if (best != 0) goes(m, best);
  }

  std::vector<Offset> moved(std::size_t m, double by) const {
    std::vector<double> step(motions_.size(), 0);
    step[m] = by;
    return offsets_of(experiment_.layout(), motions_, step, offsets_);
  }

  bool goes(std::size_t m, double by) {
    std::vector<Offset> offsets = moved(m, by);
    const double square = square_at(offsets);
    if (square > square_ - worth_it) return false;
    square_ = square;
    offsets_ = std::move(offsets);
    return true;
  }

  /// What is left of the capture, and what its pose costs; without the bias, which poses make up for, unless asked:
  /// from one coarse step to the next all the rest repeats itself.
  double square_at(const std::vector<Offset>& offsets, bool with_bias = false) const {
    std::vector<Trial> trials;
    for (int k = 0; k < seeds; ++k) {
      trials.push_back({rung_.model, offsets, seed_ + static_cast<std::uint64_t>(k)});
      trials.back().only = {capture_};
    }
    const auto simulations = simulate_typical_units(experiment_, trials, "registering by edges");
    Whitened rest = mean_of(rung_.standard, simulations).mean;
    for (std::size_t i = 0; i < rest.size(); ++i) rest[i] = rung_.data[i] - rest[i];
    compress(rest);
    double square = squares_by_capture(experiment_.layout(), rest, with_bias)[capture_];
    const auto place = values_of(motions_, offsets);
    for (std::size_t m = 0; m < motions_.size(); ++m)
      if (motions_[m].capture == capture_) square += place[m] * place[m];
    return square;
  }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const int capture_;
  const std::uint64_t seed_;
  std::vector<Offset> offsets_;
  double square_;
};

}  // namespace

bool register_by_edges(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                       const Measurement& measured, const RungOptions& options, Rung& rung) {
  constexpr int registrations = 3;        // a target that stands better teaches the spread that its place is judged by
  constexpr double worth_another = 0.01;  // of the proper score, an element
  const Layout& layout = experiment.layout();
  std::vector<int> captures = captures_that_stand_out(layout, rung);
  bool another = false;
  for (int k = 0; k < registrations; ++k) {
    std::vector<Offset> offsets = rung.offsets;
    std::vector<int> clearly_moved;
    bool moved = false;
    for (const int capture : captures) {
      Walk walk(experiment, motions, rung, capture, options.seed + 700);
      if (walk.run()) clearly_moved.push_back(capture);
      moved |= walk.offsets()[capture] != rung.offsets[capture];
      offsets[capture] = walk.offsets()[capture];
    }
    if (!moved) break;
    Rung next = made_anew(experiment, motions, measured, rung.model, offsets, options, rung.fit.parameters);
    const double now = proper_score(layout, rung, Part::all), then = proper_score(layout, next, Part::all);
    if (tracing()) fmt::print(stderr, "  registered by edges: proper {:.4f} -> {:.4f}\n", now, then);
    if (then >= now) break;
    rung = std::move(next);
    another = true;
    if (then > now - worth_another) break;
    captures = std::move(clearly_moved);
  }
  return another;
}

}  // namespace binrig
